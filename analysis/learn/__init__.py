"""Flights that diagnose themselves: what the same air, passed twice, says of the sensor."""
