"""The files that outsiders write and read, one home for each format, on one way to open, read and write files.

disk, json_files, ranges      what all share: opening and writing whole, JSON, what each quantity can be
campaign, traces              a campaign read; campaign_write: written; campaign_names: what both share
profile, diagnosis            read and written; what they hold is in profile_data and diagnosis_data, causes in both
flight, flight_rows           a log recognised and read; flight_csv, flight_netcdf: written corrected
"""
