"""Hardware of an assembly (screws, nuts, washers, pins, circlips, bearings) by shape, then by name.

A screw is a turned solid with a head and a shank in bores; a shoulder screw rests with its shoulder
on the threaded part and lets another part turn about it (ISO 7379); a pin has one diameter. Rings
are classified by width over section height: 0.7 to 1.6 for radial ball bearings of ISO 15 (608:
1.0, 6204: 1.04, 6804: 1.17), below 0.65 for washers (ISO 7089), well above for bushings and nuts.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from stiffscope.cad.assembly import Instance
    from stiffscope.cad.contacts import Contact
    from stiffscope.cad.turned import Turned

    Solids = Sequence[Instance]
    Contacts = Sequence[Contact]

_WORDS = {
    "screw": r"screws?|bolts?|schrauben?|gewindestift|iso.?(4762|4014|4017|10642)"
    r"|din.?(912|933|7991)",
    "nut": r"((lock|hex|jam|shaft|slotted|square).?)?nuts?|[a-zäöü]*muttern?|km.?\d\d?"
    r"|iso.?(4032|2982)|din.?(934|985|981|1804|557|562)",
    "washer": r"washers?|(unterleg|feder|beilag)?scheiben?|shims?|iso.?7089|din.?125",
    "pin": r"(dowel|clevis|hinge|pivot)?.?pins?|(zylinder|pass|spann|kegel)?stifte?|bolzen"
    r"|iso.?(8734|2338)|din.?6325",
    "bushing": r"bush(ing)?(es|s)?|(lager)?buchsen?|gleitlager|iso.?3547",
    "circlip": r"circlips?|(snap|retaining).?rings?|(sicherungs|spreng)ringe?|din.?47[12]",
    "bearing": r"(ball|roller|needle)?.?bearings?|(kugel|w[aä]lz|rillenkugel|nadel|zylinderrollen)?"
    r"lager|6[0-3]\d\d|6[0-9]{2}(zz|2rs)?|6[89]\d\d|iso.?15",
}
_HELD = r"(?![a-z]|[-_. ](cover|cap|hold|hous|mount|block|support|plate|seat|deckel|halter|bock))"
_NAMED = {
    role: re.compile(rf"(?<![a-z])({_WORDS[role]}){_HELD}", re.IGNORECASE)
    for role in _WORDS
}
FIT = (
    -0.01,
    0.03,
)  # of the radius: guiding fit; beyond are threads and clearance holes
_THREAD = -0.05  # of the radius: only threads overlap more
_TURNED = 0.9
_BORED = 0.8  # surface fraction turned about the axis; of cross-drilled pins
_BEARING = (0.7, 1.6)
_WASHER = 0.65  # ratio of width to section height of a ring
_BETWEEN = "a ring of a bearing's proportion between a shaft and a housing"
_NUT = 15.0  # most volume of a nut over its thread's radius³: 9 of ISO 4032, 3 to 6 of DIN 981
_WIDE = 3.2  # ratio of outer to inner diameter: washers up to 3 (ISO 7093), gears and wheels more
_THIN = 0.3
_END = 5.0  # section and diameter ratio of washers at the end of a shaft
HEADED = (
    "a head and a shank that fits its bores"  # a clevis pin, or a screw in tight holes
)
NUTTED = (
    "a head and a nut on a shank that fits its bores"  # a screw, or a threaded shaft
)
_ALONG = 0.999999  # cosine of parallel axes
_SLENDER = 12.0  # a bar with a larger ratio of length to diameter is not a pin
_SPAN = 2.0  # diameters: a bar free over more between its bores bends: no pin


@dataclass(frozen=True)
class Hardware:
    """Roles of solids by number, reasons for them, and bearings modelled with rolling elements.

    ``reasons``: also of bars that are shafts; ``pairs``: inner and outer rings of these bearings.
    """

    roles: dict[int, str]
    reasons: dict[int, str]
    pairs: tuple[tuple[int, int], ...]


def is_ambiguous(number: int, name: str, hardware: Hardware) -> bool:
    """Return whether a headed bar may be pin, screw or shaft, by its bores and its name."""
    word = {HEADED: "pin", NUTTED: "screw"}.get(hardware.reasons.get(number, ""))
    return word is not None and not _NAMED[word].search(name)


def may_be_nut(
    number: int, solids: Solids, contacts: Iterable[Contact], hardware: Hardware
) -> bool:
    """Return whether a part may be a nut on a thread drawn with its radius: small, on one axis."""
    solid = solids[number]
    form = solids[number].product.form
    touching = [
        contact for contact in contacts if number in {contact.first, contact.second}
    ]
    around = (
        contact
        for contact in _round(touching, number, inside=False)
        if contact.gap <= 0.0
    )
    tight = any(
        hardware.roles.get(contact.find_other(number), "pin") == "pin"
        for contact in around
    )
    small = form is not None and solid.product.volume < _NUT * form.bore**3
    return small and tight and _is_about_axis(touching, solid)


def find_hardware(
    solids: Solids, contacts: Contacts, given_roles: Mapping[int, str]
) -> Hardware:
    """Distinguish hardware from parts; ``given_roles``: roles given by the user, or "part", by number."""
    pairs, elements = _rolling_bearings(solids)
    found = {
        ring: ("ring", "ring of rolling elements") for pair in pairs for ring in pair
    }
    found |= dict.fromkeys(elements, ("rolling element", "between two rings"))
    touched: dict[int, list[Contact]] = {number: [] for number in range(len(solids))}
    for contact in contacts:
        touched[contact.first].append(contact)
        touched[contact.second].append(contact)
    for number in range(len(solids)):
        if number not in found:
            found[number] = _role_of(number, solids, touched[number])
    bearings = {
        number for number, (role, _) in found.items() if role in {"bearing", "ring"}
    }
    for number, solid in enumerate(solids):
        neighbours = touched[number]
        role = found[number][0]
        bare = role in {"bushing", "washer"} and not _round(
            neighbours, number, inside=True
        )
        if bare and bearings & _others(
            _round(neighbours, number, inside=False), number
        ):
            found[number] = "", ""
            continue
        turned = solid.product.form
        planes = [each for each in neighbours if each.kind == "plane"]
        if role or turned is None or not bearings & _others(planes, number):
            continue
        ring = (
            turned.bore > 0.5 * turned.radius
            and turned.share > _TURNED
            and not turned.holed
        )
        if ring and _is_about_axis(neighbours, solid):
            found[number] = "spacer", "a ring beside a bearing"
    bars = [
        n for n, (role, reason) in found.items() if role == "pin" or reason == NUTTED
    ]
    shafts = [
        n
        for n in bars
        if len(_find_ends(n, found, touched, dict(pairs))) < 2
        or _free_span(n, touched[n]) > _SPAN
    ]
    found |= {n: ("", found[n][1]) for n in shafts}
    found |= {
        number: ("" if role == "part" else role, "said so")
        for number, role in given_roles.items()
    }
    roles = {number: role for number, (role, _) in found.items() if role}
    both = tuple(
        pair for pair in pairs if {roles.get(ring) for ring in pair} == {"ring"}
    )
    reasons = {number: reason for number, (_, reason) in found.items() if reason}
    return Hardware(roles, reasons, both)


def _role_of(number: int, solids: Solids, touched: Contacts) -> tuple[str, str]:
    """Return role and reason: by shape if all contacts are about the solid's axis, else by name."""
    solid = solids[number]
    form = solids[number].product.form
    if any(neighbour.kind == "sphere" for neighbour in touched):
        return "", ""  # a ball stud or rod end
    role, reason = _role_by_shape(number, solids, touched)
    if role and not _is_about_axis(touched, solid):
        return "", ""
    words = [
        (match.start(), word)
        for word in _NAMED
        for match in _NAMED[word].finditer(solid.name)
    ]
    named = max(words, default=(0, ""))[
        1
    ]  # the last one, as in "nut-bolt-assembly.nut"
    share = (
        0.2 if named in {"screw", "nut", "circlip"} else 0.6
    )  # turned: no plate named after one
    may_be = (
        form is not None
        and form.share > share
        and _is_about_axis(_round(touched), solid)
    )
    if named and ((not role and may_be) or (role, named) == ("pin", "screw")):
        return named, "its name"
    return role, reason


def _find_ends(
    pin: int,
    found: Mapping[int, tuple[str, str]],
    touched: Mapping[int, Contacts],
    outer: Mapping[int, int],
) -> set[int]:
    """Return the solids that a pin joins, beyond bushings and bearings; none if a shaft of these."""
    ends = set[int]()
    held = set[str]()
    roles = {found[other][0] for other in _others(touched[pin], pin)}
    nuts = {"shaft nut", "nut"} if roles & {"bearing", "ring"} else {"shaft nut"}
    for contact in _round(touched[pin], pin, inside=True):
        other = contact.find_other(pin)
        role = found[other][0]
        if contact.gap > FIT[1] * contact.radius or role in nuts:
            continue
        held.add(role)
        ring = outer.get(other, other)
        around = _others(_round(touched[ring], ring, inside=True), ring)
        ends |= around if role in {"bushing", "bearing", "ring"} else {other}
    return set() if held <= {"bearing", "ring"} else ends


def _free_span(bar: int, touched: Contacts) -> float:
    """Return the longest stretch of a bar between two of its bores, over its diameter."""
    bores = _round(touched, bar, inside=True)
    if not bores:
        return 0.0
    along = bores[0].axis
    ends = sorted(
        (bore.point @ along - 0.5 * bore.size, bore.point @ along + 0.5 * bore.size)
        for bore in bores
    )
    longest = 0.0
    reached = ends[0][1]
    for low, high in ends[1:]:
        longest = max(longest, float(low - reached))
        reached = max(reached, high)
    return longest / (2.0 * min(bore.radius for bore in bores))


def _role_by_shape(number: int, solids: Solids, touched: Contacts) -> tuple[str, str]:
    """Return role and reason, or two empty texts."""
    form = solids[number].product.form
    if form is None or (not form.steps and not form.bores):
        return "", ""
    inside = _round(touched, number, inside=True)
    around = bool(_round(touched, number, inside=False))
    if form.bore:
        fits = [contact for contact in inside if contact.gap < FIT[1] * contact.radius]
        host = fits[0].find_other(number) if fits else None
        planes = (neighbour for neighbour in touched if neighbour.kind == "plane")
        sides = [plane.axis for plane in planes if plane.find_other(number) == host]
        grooved = any(float(one @ other) < -_ALONG for one in sides for other in sides)
        return _role_of_ring(form, bool(fits), around, grooved)
    if inside and _is_shoulder_screw(form, number, inside, touched):
        return (
            "shoulder screw",
            "a head, a shoulder in a bore and a thread on which it rests",
        )
    return _role_of_bar(form, number, inside, solids) if inside else ("", "")


def _role_of_ring(
    form: Turned, inside: bool, around: bool, grooved: bool
) -> tuple[str, str]:
    """Return role and reason of a ring inside or around other solids, or in a groove of a bore."""
    low, high = _BEARING
    if around and not inside:
        if form.hexagon and form.share > _TURNED and form.length < 3.0 * form.radius:
            return "nut", "a hexagon around a thread"
        if (
            form.slotted
            and form.steps
            and form.share > 0.6
            and form.length < form.radius
        ):
            return "shaft nut", "a ring with slots around a thread"
    section = low <= form.section <= high and 0.25 <= form.bore / form.radius <= 0.9
    if form.share > _TURNED and section and inside and around:
        return "bearing", _BETWEEN
    plain = form.share > _TURNED and not form.holed
    wide = _END if form.section < _THIN else _WIDE
    clips = (grooved and not around) if inside else form.radius < wide * form.bore
    if plain and clips and 0.0 < form.section < _WASHER:
        return "circlip" if inside else "washer", "a flat ring"
    if (
        plain
        and around
        and form.body[0] < 2.0 * form.bore
        and form.length < 4.0 * form.radius
    ):
        return "bushing", "a ring around a pin or shaft"
    return "", ""


def _role_of_bar(
    form: Turned, number: int, inside: Contacts, solids: Solids
) -> tuple[str, str]:
    """Return role and reason of a solid with a shank in bores.

    A screw's bores have play or are threads, drawn with overlap or equal radius. A bar guiding a
    part on a step wider than its shank is a shaft; a headed bar fitting all bores is a clevis pin.
    """
    radius, length = form.body
    bores = _others(inside, number)
    fitting = [
        contact
        for contact in inside
        if FIT[0] <= contact.gap / contact.radius <= FIT[1]
    ]
    around = [solids[other].product.form for other in bores]
    nuts = [
        other for other in around if other is not None and other.hexagon and other.bore
    ]
    if form.radius >= 1.3 * radius and form.share > 0.5 and length > 0.5 * form.length:
        if any(contact.radius > 1.05 * radius for contact in fitting):
            return "", ""
        loose = len(fitting) < len(inside)
        if loose or nuts:
            why = "a head and a shank in a bore with play or a thread"
            return "screw", why if loose else NUTTED
        return ("pin", HEADED) if len(bores) > 1 else ("", "")
    plain = form.share > _BORED and form.radius < 1.15 * radius
    if not plain or form.length > _SLENDER * 2.0 * radius or len(bores) < 2:
        return "", ""
    threads = _others(
        (contact for contact in inside if contact.gap < _THREAD * contact.radius),
        number,
    )
    if threads and threads >= _others(fitting, number):
        return "screw", "a thread and a tip without a head"
    return "pin", f"one diameter, in bores of {len(bores)} others"


def _is_shoulder_screw(
    form: Turned, number: int, inside: Contacts, touched: Contacts
) -> bool:
    """Return whether a headed bar guides a part on its shoulder and rests on the threaded part."""
    guides = [
        contact
        for contact in inside
        if FIT[0] <= contact.gap / contact.radius <= FIT[1]
    ]
    guide = max(guides, key=lambda each: each.radius, default=None)
    if guide is None or form.radius < 1.3 * guide.radius:
        return False
    under = _others(
        (neighbour for neighbour in touched if neighbour.kind == "plane"), number
    )
    slim = 0.95 * guide.radius
    steps = sorted(form.steps, key=lambda step: step[1] - step[0])
    narrow = [step for step in steps if step[2] < slim]
    held = _others((contact for contact in inside if contact.radius < slim), number)
    if not narrow or not held & under - {guide.find_other(number)}:
        return False
    thread = sum(narrow[-1][:2])
    head = sum(max(steps, key=lambda step: step[2])[:2])
    shoulder = sum(min(steps, key=lambda step: abs(step[2] - guide.radius))[:2])
    return (head - shoulder) * (shoulder - thread) >= 0.0


def _is_about_axis(contacts: Contacts, solid: Instance) -> bool:
    """Return whether all contacts are about the axis of a solid."""
    if solid.product.form is None:
        return not contacts
    point, axis = solid.place_axis(solid.product.form)
    levers = ((c.axis, 1e-4) for c in contacts)
    arms = ((c.point - point, 1e-5) for c in contacts if c.kind != "plane")
    return all(
        np.linalg.norm(np.cross(axis, each)) < most for each, most in (*levers, *arms)
    )


def _round(
    contacts: Contacts, number: int = -1, *, inside: bool | None = None
) -> list[Contact]:
    """Return the cylindrical contacts; if given, only those with a solid inside, or around."""
    round_contacts = [contact for contact in contacts if contact.kind == "cylinder"]
    if inside is None:
        return round_contacts
    return [
        c
        for c in round_contacts
        if ((c.first, c.second)[c.inner or 0] == number) is inside
    ]


def _others(contacts: Iterable[Contact], number: int) -> set[int]:
    """Return the solids that contacts join to one."""
    return {contact.find_other(number) for contact in contacts}


def _rolling_bearings(solids: Solids) -> tuple[list[tuple[int, int]], set[int]]:
    """Return pairs of rings with three or more equal rolling elements, and elements with cages."""
    forms = [solid.product.form for solid in solids]
    rings = [
        n for n, form in enumerate(forms) if form and form.bore and form.share > _TURNED
    ]
    pairs = []
    within = set[int]()
    for inner in rings:
        for outer in rings:
            between = _find_between(inner, outer, solids)
            volumes = np.array([solids[number].product.volume for number in between])
            if any(
                np.isclose(volumes, volume, rtol=1e-6).sum() >= 3 for volume in volumes
            ):
                pairs.append((inner, outer))
                within |= set(between)
    return pairs, within


def _find_between(inner: int, outer: int, solids: Solids) -> list[int]:
    """Return the solids between two coaxial rings."""
    small = solids[inner].product.form
    large = solids[outer].product.form
    if (
        inner == outer
        or small is None
        or large is None
        or not small.radius < large.radius
    ):
        return []
    (point, axis) = solids[inner].place_axis(small)
    (other, along) = solids[outer].place_axis(large)
    across = np.linalg.norm(np.cross(axis, other - point))
    parallel = np.linalg.norm(np.cross(axis, along))
    middles = [float(axis @ (solids[n].centre - point)) for n in (inner, outer)]
    apart = abs(middles[0] - middles[1]) > 0.5 * small.length
    if parallel > 1e-4 or across > 2e-5 or apart or large.bore < small.bore:
        return []
    elements = []
    for number, solid in enumerate(solids):
        away = solid.centre - point
        form = solid.product.form
        along = float(axis @ away) - middles[0]
        apart = float(np.linalg.norm(np.cross(axis, away)))
        reach = float(np.linalg.norm(np.diff(solid.box, axis=0)))
        ball = small.middle < apart < large.middle and reach < 2.0 * (
            large.radius - small.bore
        )
        cage = (
            form is not None
            and small.bore < form.radius < large.radius
            and apart < 1e-5
        )
        cage &= form is not None and form.bore > small.bore
        if (
            number not in {inner, outer}
            and abs(along) < 0.5 * small.length
            and (ball or cage)
        ):
            elements.append(number)
    return elements
