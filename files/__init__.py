"""The files that outsiders write and read: campaign, profile, diagnosis, flight; one module for each format."""
