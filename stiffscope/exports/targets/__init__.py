"""The targets of `stiffscope export`: every module defines ``TARGET`` and is named as `--to` has it."""
