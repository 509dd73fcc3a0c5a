"""The gate: every file from outside is opened here.

A path is resolved, what points elsewhere is refused, structure is counted before anything is built, and every
failure is one sentence with the file's name.
"""
