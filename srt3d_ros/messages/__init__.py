"""ROS messages ⇄ NumPy, for each topic of msg_schemas/.

Messages are serialised bytes, as raw subscriptions, bags and `publish` have them: every topic's module, or its codec in
`photon_frames`, has `encode_cdr` and `decode_cdr`. CameraInfo alone is an object. Decoding checks layout and sizes.
`PhotonFrame.check` then checks the photons' values, once, in `SketchStream.push`.
"""
