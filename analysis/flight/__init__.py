"""Flights: weather to fly through, the sensor in it, three ways to correct its readings, and how to judge them."""
