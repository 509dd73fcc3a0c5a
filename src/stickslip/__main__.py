"""``stickslip`` and ``python -m stickslip``: the command line."""


def main() -> None:
    """Run it; Ctrl-C ends it quietly, also while it is being imported."""
    try:
        from .cli import app

        app(prog_name="stickslip")
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    finally:
        # Python kills itself by SIGINT at its end if a KeyboardInterrupt has ever left an `exec` of text, as
        # libraries are full of, caught or not; it forgets that with the next.
        exec("")


if __name__ == "__main__":
    main()
