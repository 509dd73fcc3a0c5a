"""The gate: every file from outside is opened here.

Links in paths are resolved, and files that refer to other files are refused. The size of a file's structure
is counted before anything is built from the file. Every failure is one sentence with the file's name.
"""
