"""Chambers and fans as devices: what makes the two airs and moves them, by SCPI, by Modbus, or by a person."""
