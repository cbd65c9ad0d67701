"""Hostile input, broken machines and long runs: what the package survives, measured."""
