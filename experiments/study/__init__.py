"""The tables of a study's README, computed from its rows."""
