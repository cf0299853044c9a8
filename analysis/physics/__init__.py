"""Closed forms: modes, bodies, humidity, the measurement chain, the published schemes."""
