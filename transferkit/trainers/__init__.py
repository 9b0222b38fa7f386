"""Trainers: PPO, DYNA-DDPG and DYNA-PPO behind one interface, and the loop that drives each of them."""
