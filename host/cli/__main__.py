"""The program `swarmloc`: loads the commands' group, and runs the one asked for."""

import signal


def main() -> None:
    """Run; until the group is loaded Ctrl-C ends it without a traceback."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    from host.cli.main import main as command

    signal.signal(signal.SIGINT, signal.default_int_handler)
    command()


if __name__ == "__main__":
    main()
