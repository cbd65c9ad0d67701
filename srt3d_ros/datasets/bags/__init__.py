"""rosbag2 bags: reading, writing, and the photons or sketches in them."""
