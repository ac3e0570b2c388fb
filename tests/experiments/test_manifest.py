"""What a manifest says went in."""

import pytest

from stiffscope.experiments.manifest import manifest_of
from stiffscope.runtime.reading import file_digest

pytestmark = pytest.mark.slow


def test_files_of_one_name_in_two_folders_both_go_in(tmp_path):
    paths = [
        tmp_path / name
        for name in ("campaign.toml", "day1/readings.csv", "day2/readings.csv")
    ]
    for path in paths:
        path.parent.mkdir(exist_ok=True)
        path.write_text(str(path))
    found = manifest_of(None, *paths).sources["inputs"]
    assert found == {
        path.relative_to(tmp_path).as_posix(): file_digest(path) for path in paths
    }
    assert set(manifest_of(None, paths[1]).sources["inputs"]) == {"readings.csv"}
