"""``stickslip`` and ``python -m stickslip``: the command line."""


def main() -> None:
    """Run it; Ctrl-C ends it quietly, also while it is being imported."""
    try:
        from .cli import app

        app(prog_name="stickslip")
    except KeyboardInterrupt:
        raise SystemExit(130) from None


if __name__ == "__main__":
    main()
