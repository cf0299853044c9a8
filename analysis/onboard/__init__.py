"""The causal corrector as programs for autopilots: C99 and Lua, with a profile's tables as constants."""
