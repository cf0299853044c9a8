"""Stages: what carries the probes from the source air to the destination air."""
