"""What only developers measure: it takes long, needs root, or answers no question of a user. See __main__.py."""
