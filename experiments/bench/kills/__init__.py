"""Kill jobs at every file operation and at random times, run them again, and compare with runs that nobody killed."""
