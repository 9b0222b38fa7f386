"""A page, figures and tables of a matrix of runs."""
