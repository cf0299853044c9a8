"""The bench: everything that touches an instrument, or stands in for one."""
