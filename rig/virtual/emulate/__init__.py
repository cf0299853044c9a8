"""Emulated instruments for other people's programs, in real time: serial ones on pseudo-terminals, I2C ones behind a
socket and a preload library."""
