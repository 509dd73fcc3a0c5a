"""``stickslip`` and ``python -m stickslip``: the command line."""

import gc

# New objects between two looks for unused ones. By Python's default these take a tenth of a command's time;
# what they look through is mostly of modules, which stay.
NEW_OBJECTS = 10_000


def main() -> None:
    """Run it; Ctrl-C ends it quietly, also while it is being imported."""
    gc.set_threshold(NEW_OBJECTS)
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
