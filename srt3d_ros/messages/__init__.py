"""ROS messages ⇄ NumPy, one module for each topic of msg_schemas/. Message classes only: no nodes, no algorithm.

Messages are serialised bytes, which a raw subscription and a bag hand out and `publish` takes: every topic module has
`encode_cdr` and `decode_cdr`. Latched texts and CameraInfo, which nodes receive as objects, have functions for those.
"""
