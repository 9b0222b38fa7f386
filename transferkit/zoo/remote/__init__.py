"""Zoos over the network: folders at URLs with an index, from which cores are pulled into a cache."""
