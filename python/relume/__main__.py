"""The command `relume`."""

import sys


def main():
    from ._relume import _command

    sys.exit(_command(["relume", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
