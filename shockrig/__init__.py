"""Characterization, diagnosis and flight correction of thermo-hygrometers for weather drones."""
