"""Logs of other people's loggers as they are: one text file of any layout, with any number of sensors and steps.

text and table (bytes to columns), stamps (columns to seconds), units, log (all of it together), mapping (the map a
user edits), guess and known (a first map), changes, onset and steps (what happened when), runs (what is written).
"""
