"""Measurements for developers: they take long, need root or a GPU, or answer no question of a user. See __main__.py."""
