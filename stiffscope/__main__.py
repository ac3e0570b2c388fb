"""`python -m stiffscope`: the command line."""

from stiffscope.cli.main import main

main()
