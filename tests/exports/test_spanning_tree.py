"""Trees of bodies: every loop of a deep tree closes along one chain."""

import pytest

from stiffscope.exports.spanning_tree import span_deep_tree, span_tree
from stiffscope.robot.mechanism_of import rigid_mechanism
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.model.checks import GROUND

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", ["delta", "stewart", "biglide", "serial-arm"])
def test_joints_that_close_loops_lead_back_to_an_ancestor(name):
    mechanism = rigid_mechanism(load_robot(name))
    tree = span_deep_tree(mechanism)
    parents = {b.body: mechanism.carrier(b.parent) for b in tree.branches}
    assert set(parents) == {body.name for body in mechanism.bodies}
    assert len(tree.cuts) == len(span_tree(mechanism).cuts)
    for cut in tree.cuts:
        ancestors = [mechanism.carrier(cut.parent)]
        while ancestors[-1] != GROUND:
            ancestors.append(parents[ancestors[-1]])
        assert cut.body in ancestors
