"""Buses: bytes in, bytes out, over smbus2 and pyserial."""
