"""Run commands on disks that are too small, make room, and run them again."""
