"""Doubts of an import: ambiguous contacts and solids for a person to check, with both readings."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.imports.hardware import FIT, is_ambiguous, may_be_nut
from stiffscope.robot.inspection import Doubt

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from stiffscope.cad.assembly import Instance
    from stiffscope.cad.built_assembly import BuiltJoint
    from stiffscope.cad.contacts import Contact
    from stiffscope.imports.hardware import Hardware
    from stiffscope.imports.part_motions import Bond, Freedom

    Solids = Sequence[Instance]
    Contacts = Sequence[Contact]


def doubt_threads(
    joint: Freedom,
    turning: str,
    bonds: Sequence[Bond],
    solids: Solids,
    hardware: Hardware,
    contacts: Contacts,
) -> list[Doubt]:
    """Return doubts on headed bars and small rings: they move if they turn, and hold if threaded.

    ``turning`` is the kind of the joint if its screws with nuts turn in their bores.
    """
    pair = "/".join(solids[n].name for n in joint.ends)
    moving = joint.kind != "fixed"
    doubts = list[Doubt]()

    def doubt(
        number: int, taken: str, other: str, makes: str, short: str, say: str = ""
    ) -> None:
        name = solids[number].name
        text = f"a {taken}, which makes {pair} {joint.kind}, or a {other}, which makes it {makes}: "
        text += f"taken as a {taken}; if it is a {short}, say " + (
            say or f'--weld "{name}"'
        )
        doubts.append(Doubt((name,), text, tuple(joint.at)))

    for n in dict.fromkeys(end for bond in bonds for end in bond.ends):
        role = hardware.roles.get(n, "")
        name = solids[n].name
        if not is_ambiguous(n, name, hardware):
            continue
        if role == "pin" and moving:
            doubt(
                n, "clevis pin", "screw in holes of its own diameter", "fixed", "screw"
            )
        elif role == "screw" and turning != joint.kind:
            say = f'--joint "{pair}={turning or "KIND"}"'
            other = "pin that turns in holes of its own diameter"
            doubt(n, "screw with a nut", other, turning or "move", "pin", say)
        elif role == "screw" and moving:
            makes = f"{turning} with a part of its own between"
            doubt(
                n,
                "screw with a nut",
                "shaft that turns",
                makes,
                "shaft",
                f'--part "{name}"',
            )
        elif not role and moving:
            doubt(n, "shaft with a nut", "screw with a nut", "no joint", "screw")
    for n in joint.ends:
        if moving and may_be_nut(n, solids, contacts, hardware):
            other = "nut on a thread drawn with its own radius"
            doubt(n, "part that turns on a shaft", other, "fixed", "nut")
    return doubts


def doubt_bores(
    solids: Solids,
    contacts: Contacts,
    hardware: Hardware,
    adds: Callable[[Contact], bool],
) -> list[Doubt]:
    """Return doubts on bores that are too wide to guide or tight enough to hold, if it matters."""
    contacts_by_bore = defaultdict[tuple[str, str, str], dict[str, "Contact"]](dict)
    for contact in contacts:
        bought = hardware.roles.keys() & {contact.first, contact.second}
        if bought or contact.kind not in {"cylinder", "sphere"}:
            continue
        if not FIT[0] <= contact.gap / contact.radius <= FIT[1] and adds(contact):
            gap = 1e3 * abs(contact.gap)
            size = 1e3 * contact.radius
            way = "play" if contact.gap > 0 else "overlap"
            what = (
                f"a {contact.kind} of radius {size:.4g} mm with {gap:.3g} mm of {way}"
            )
            tight = contact.kind == "cylinder" and contact.gap < 0
            taken = "a thread or a press fit, which holds" if tight else "no guide"
            i, j = (solids[n].name for n in (contact.first, contact.second))
            say = f'taken as {taken}; if it guides, say --joint "{i}/{j}=KIND"'
            contacts_by_bore[i, j, say].setdefault(what, contact)
    return [
        Doubt(
            (i, j),
            f"{' and '.join(there)}: {say}",
            tuple(next(iter(there.values())).point),
        )
        for (i, j, say), there in contacts_by_bore.items()
    ]


def doubt_built(
    joints: Iterable[Freedom],
    built_joints: Iterable[Freedom],
    built: Iterable[BuiltJoint],
    solids: Solids,
) -> list[Doubt]:
    """Return doubts on joints of the assembly that differ in kind from those by contacts alone."""
    labels = {frozenset((joint.first, joint.second)): joint.label for joint in built}
    kinds = {frozenset(joint.ends): joint.kind for joint in built_joints}
    doubts = []
    for joint in joints:
        pair = frozenset(joint.ends)
        other = kinds.get(pair, joint.kind)
        if pair in labels and other != joint.kind:
            names = tuple(solids[n].name for n in joint.ends)
            text = f"{labels[pair]} makes it {joint.kind}, what touches makes it {other}: taken as "
            text += f'the assembly has it; for the other, say --joint "{"/".join(names)}={other}"'
            doubts.append(Doubt(names, text, tuple(joint.at)))
    return doubts


def doubt_twins(solids: Solids) -> list[Doubt]:
    """Return doubts on solids with the same centre and volume as another."""
    seen = dict[tuple[int, ...], str]()
    doubts = list[Doubt]()
    for solid in solids:
        places = (*map(float, solid.centre), float(np.cbrt(solid.product.volume)))
        key = tuple(round(1e6 * place) for place in places)
        if key in seen:
            text = "the same solid twice in one place; remove one in CAD"
            doubts.append(Doubt((seen[key], solid.name), text, places[:3]))
        seen.setdefault(key, solid.name)
    return doubts


def gather_alike(doubts: Sequence[Doubt], solids: Solids) -> list[Doubt]:
    """Merge similar doubts on solids of the same products."""
    products = {solid.name: solid.product.number for solid in solids}
    alike = dict[tuple[object, ...], list[Doubt]]()
    for doubt in doubts:
        text = doubt.text
        for name in doubt.solids:
            text = text.replace(name, "")
        key = (*(products.get(name, name) for name in doubt.solids), text)
        alike.setdefault(key, []).append(doubt)
    more = {same[0]: len(same) - 1 for same in alike.values()}
    return [
        replace(d, text=d.text + (f" ({n} more alike)" if n > 0 else ""))
        for d, n in more.items()
    ]
