"""The command line: each command reads its input, calls the rooms below, and shows what they return."""

import multiprocessing

from stiffscope.runtime.children import end_with_parent

if multiprocessing.parent_process() is not None:  # a worker begins with its parent's main module, before all else
    end_with_parent()
