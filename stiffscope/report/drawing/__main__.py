"""The drawing process: draws what an order file of `stiffscope.report.pictures.drawing` asks for."""

import json
import os
import sys
from pathlib import Path

from stiffscope.runtime.children import end_with_parent

end_with_parent()  # before what takes seconds to import
from stiffscope.report.drawing.camera import warm_up  # noqa: E402
from stiffscope.report.drawing.part import part_pictures  # noqa: E402
from stiffscope.report.drawing.robot import animation, robot  # noqa: E402

if "ahead" in sys.argv:
    warm_up()
order = json.loads(Path(sys.stdin.read()).read_text())  # waits until it is there
{"part_pictures": part_pictures, "robot": robot, "animation": animation}[order["picture"]](
    Path(order["target"]), **order["arguments"]
)
os._exit(0)  # VTK's own end has been seen to crash after the picture was there
