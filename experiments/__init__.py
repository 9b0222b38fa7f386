"""Scripts that run many trainings and compare them; they import transferkit, never the other way round."""
