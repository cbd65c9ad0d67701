"""Read rosbag2 bags, and the photons or sketches in them."""
