"""Pictures of a run are drawn in other processes, whatever executes its experiments."""

from stiffscope.experiments.manifest import manifest_of
from stiffscope.report.kept_pictures import Order, write_pictures
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.workshop import workshop


def test_drawing_that_fails_costs_the_picture_and_no_more(tmp_path, caplog):
    """Experiments in this process: what fails in drawing, even in the library, stays outside."""

    def write(folder, draw_now):
        draw_now("no such picture", folder / "none.png")

    manifest = manifest_of(load_robot("five-bar"))
    with workshop() as shop:
        orders = [Order("robot", "0" * 64, write, tmp_path)]
        write_pictures(orders, shop.cache, shop.executor, manifest)
    assert "no pictures" in caplog.text
    assert not list(tmp_path.iterdir())
