"""Policies: from raw observations to a distribution over actions, from scratch or around a core."""
