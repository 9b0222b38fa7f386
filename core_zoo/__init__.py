"""Data only: the core artifacts that are installed with transferkit, one folder a version."""
