"""Simulated flights: weather, the sensor flown through it, and how near each correction comes to the truth."""
