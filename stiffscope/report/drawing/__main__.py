"""The drawing process: draws what an order file of `stiffscope.report.pictures.draw` asks for."""

import json
import os
import sys
from pathlib import Path

from stiffscope.children import end_with_parent

end_with_parent()  # before what takes seconds to import
from stiffscope.report.drawing.part import part_pictures  # noqa: E402
from stiffscope.report.drawing.robot import animation, robot  # noqa: E402

order = json.loads(Path(sys.argv[1]).read_text())
{"part_pictures": part_pictures, "robot": robot, "animation": animation}[order["picture"]](
    Path(order["target"]), **order["arguments"]
)
os._exit(0)  # VTK's own end has been seen to crash after the picture was there
