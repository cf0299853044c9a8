"""What ships with shockrig: protocol files, JSON Schemas, example campaigns and profiles, each with its provenance.

Read it as `importlib.resources.files("shockrig.data")`.
"""
