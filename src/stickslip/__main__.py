"""``stickslip`` and ``python -m stickslip``: the command line."""

import gc

# Number of new objects after which Python's garbage collector searches for unused objects. With Python's
# default, which is lower, the search takes a tenth of a command's time without finding much: most objects
# belong to imported modules.
NEW_OBJECTS = 10_000


def main() -> None:
    """Run the command line; Ctrl-C ends the program without a traceback, also during the imports, with the
    exit code 130."""
    gc.set_threshold(NEW_OBJECTS)
    try:
        from .cli import app

        app(prog_name="stickslip")
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    finally:
        # Without this line the exit code may be lost: if a KeyboardInterrupt has ever left an `exec` of a
        # text, which many libraries use, Python ends itself by SIGINT. The next successful `exec` resets that
        # state.
        exec("")


if __name__ == "__main__":
    main()
