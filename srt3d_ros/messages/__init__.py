"""ROS messages ⇄ NumPy, one module for each topic of msg_schemas/.

Messages are serialised bytes, as raw subscriptions, bags and `publish` have them: every topic module has `encode_cdr`
and `decode_cdr`. Descriptions and CameraInfo, which nodes receive or send as objects, have functions for those, too.
Decoding checks layout and sizes. `PhotonFrame.check` then checks the photons' values, once, in `SketchStream.push`.
"""
