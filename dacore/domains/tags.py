"""Which facets of a mesh file stand for which role."""

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dacore.core.arrays import IntArray
from dacore.errors import MeshError
from dacore.io.mesh import RawMesh

Tag: TypeAlias = int | str


def facet_tags(path: str, raw: RawMesh, facet_kind: str, tag_data: str) -> IntArray:
    """Tags (f,) of the facets, from the cell data `tag_data` or the only one that can be meant.

    Raises
    ------
    MeshError
        If there is no such data, or several, or they are not whole numbers.
    """
    count = len(raw.cells[facet_kind])
    # Values that are missing for some facets cannot be told apart any more.
    usable = {name: data[facet_kind] for name, data in raw.data.items() if len(data[facet_kind]) == count}
    whole = [name for name, values in usable.items() if _is_whole(values)]
    if not tag_data:
        candidates = [name for name in whole if not name.startswith("gmsh:")]
        if "gmsh:physical" in whole:
            candidates = ["gmsh:physical"]
        elif not candidates:
            candidates = [name for name in whole if name == "gmsh:geometrical"]
        if not candidates:
            raise MeshError(f"{path}: its {facet_kind}s are not tagged; save whole-numbered cell data with them")
        if len(candidates) > 1:
            raise MeshError(f"{path}: tags may be {', '.join(sorted(candidates))}; set tag_data to one of them")
        tag_data = candidates[0]
    if tag_data not in usable:
        raise MeshError(f"{path}: has no cell data {tag_data!r}, expected one of {', '.join(sorted(usable)) or 'none'}")
    if tag_data not in whole:
        raise MeshError(f"{path}: cell data {tag_data!r} are not whole numbers; choose other tag_data")
    tags = usable[tag_data].astype(np.int64)
    # Gmsh marks entities of reversed orientation by a negative tag.
    return np.abs(tags) if tag_data.startswith("gmsh:") else tags


def role_tags(
    path: str,
    names: Mapping[str, tuple[int, int]],
    roles: Mapping[str, Tag | tuple[Tag, ...]],
    dim: int,
    tags: IntArray,
) -> dict[str, tuple[int, ...]]:
    """Tags of each role.

    Raises
    ------
    MeshError
        If a name or tag is not in the file, or two roles share one.
    """
    physical = {name: tag for name, (tag, name_dim) in names.items() if name_dim == dim - 1}
    if not roles and not physical:
        raise MeshError(f"{path}: names no groups of facets; set roles, such as neck = 1 (tags: {_list(tags)})")
    found: dict[str, tuple[int, ...]] = {}
    owner: dict[int, str] = {}
    for role, given in (roles or physical).items():
        values = []
        for item in given if isinstance(given, (tuple, list)) else (given,):
            if isinstance(item, str):
                if item not in physical:
                    raise MeshError(
                        f"{path}: role {role!r} names {item!r}, which is no physical group of facets; "
                        f"the file has {', '.join(sorted(physical)) or 'none'}"
                    )
                tag = physical[item]
            else:
                tag = int(item)
            if not (tags == tag).any():
                raise MeshError(f"{path}: role {role!r} has tag {tag}, but no facet; the file has tags {_list(tags)}")
            if owner.setdefault(tag, role) != role:
                raise MeshError(f"{path}: tag {tag} is given to the roles {owner[tag]!r} and {role!r}")
            values.append(tag)
        if not values:
            raise MeshError(f"{path}: role {role!r} has no tags; give it one or leave it out")
        found[role] = tuple(values)
    return found


def _is_whole(values: NDArray[Any]) -> bool:
    if values.dtype.kind in "iu":
        return True
    return values.dtype.kind == "f" and bool(np.isfinite(values).all() and (values == np.round(values)).all())


def _list(tags: IntArray) -> str:
    every = np.unique(tags).tolist()
    return ", ".join(map(str, every[:12])) + (", …" if len(every) > 12 else "")
