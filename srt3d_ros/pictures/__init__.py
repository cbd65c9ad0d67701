"""Draw pictures of clouds without a screen, with matplotlib and Pillow."""
