from .running import run_file as run_file
