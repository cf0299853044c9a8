"""Sensor drivers: each asks its bus and returns readings."""
