"""Emulated instruments at the byte level; they sample one physical world and know nothing of the drivers."""
