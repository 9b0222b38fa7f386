"""Cores as versioned artifacts."""
