"""Run grids of trainings, each run in a process and a folder of its own."""
