"""Recordings of episodes as MCAP files: written, read, replayed, learnt from."""
