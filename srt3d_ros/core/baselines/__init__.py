"""The methods that the SRT3D paper compares, each written from its own paper; srt3d_ros.core.methods names them all."""
