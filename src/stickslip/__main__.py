"""``python -m stickslip``: the command line."""

from .cli import app

app(prog_name="stickslip")
