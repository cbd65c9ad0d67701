"""ROS messages ⇄ NumPy, one module for each topic of msg_schemas/. Message classes only: no nodes, no algorithm.

Every topic module has `encode` and `decode` for the typed message and, for binary topics, `encode_cdr` and
`decode_cdr` for its serialised bytes: what a raw subscription and a bag hand out, and what `publish` takes as it is.
"""
