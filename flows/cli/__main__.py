"""`python -m flows.cli` is `gravcal`."""

from flows.cli import main

if __name__ == "__main__":
    main()
