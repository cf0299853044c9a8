"""Logs of other people's loggers as they are: one text file of any layout, with any number of sensors and steps.

text, clocks, stamps, units, order, log (bytes to seconds and values); mapping, map_file (the map a user edits); guess,
known, first_map (a first map); channels, changes, onset, steps, found (what happened when); windows, runs, campaigns
(what is written).
"""
