"""The drawing process."""

import sys

from stiffscope.report.drawing import main

main(sys.argv[1])
