"""Channels, noise, models and fits with random effects for each run; knows no effect by name."""
