"""Small meshes for the tests of the CAD layer, as arrays; all closed, wound outwards, in mm."""

from __future__ import annotations

import numpy as np
import trimesh

from acp_lab.cad.part import Part


def box(size: tuple[float, float, float] = (40.0, 20.0, 10.0)) -> trimesh.Trimesh:
    """A box about the origin: 8 vertices, 12 faces."""
    return trimesh.creation.box(size)


def bushing() -> Part:
    """A turned part with a bore and a flange, off its origin: it hides some of itself from most sides."""
    profile = [[8.0, 0.0], [20.0, 0.0], [20.0, 5.0], [12.0, 5.0], [12.0, 25.0], [8.0, 25.0], [8.0, 0.0]]
    mesh = trimesh.creation.revolve(np.array(profile), sections=24)
    mesh.apply_translation([30.0, -10.0, 5.0])
    return Part.from_mesh(mesh.vertices, mesh.faces, "bushing")


def plate(left: float, top: float, right: float, bottom: float, z: float = 0.0) -> Part:
    """One open rectangle of two triangles in the plane z."""
    corners = [[left, top, z], [right, top, z], [right, bottom, z], [left, bottom, z]]
    return Part.from_mesh(corners, [[0, 1, 2], [0, 2, 3]], "plate")


def step_box(size: tuple[float, float, float], inches: bool = False) -> str:
    """A STEP (AP214) file of a box with one corner at the origin, its numbers in mm or in inches."""
    corners = [(i * size[0], j * size[1], k * size[2]) for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    lines: list[str] = []

    def add(entity: str) -> str:
        lines.append(f"#{len(lines) + 1}={entity};")
        return f"#{len(lines)}"

    def numbers(values: object) -> str:
        return "(" + ",".join(f"{value:.6f}" for value in np.asarray(values)) + ")"

    points = [add(f"CARTESIAN_POINT('',{numbers(corner)})") for corner in corners]
    faces = []
    for quad in quads:
        a, b, c = (np.array(corners[i]) for i in quad[:3])
        normal, side = np.cross(b - a, c - b), b - a
        loop = add(f"POLY_LOOP('',({','.join(points[i] for i in quad)}))")
        bound = add(f"FACE_OUTER_BOUND('',{loop},.T.)")
        axis = add(f"DIRECTION('',{numbers(normal / np.linalg.norm(normal))})")
        reference = add(f"DIRECTION('',{numbers(side / np.linalg.norm(side))})")
        place = add(f"AXIS2_PLACEMENT_3D('',{points[quad[0]]},{axis},{reference})")
        plane = add(f"PLANE('',{place})")
        faces.append(add(f"FACE_SURFACE('',({bound}),{plane},.T.)"))
    shell = add(f"CLOSED_SHELL('',({','.join(faces)}))")
    solid = add(f"FACETED_BREP('',{shell})")
    length = add("(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.))")
    if inches:
        dimensions = add("DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.)")
        measure = add(f"LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),{length})")
        length = add(f"(CONVERSION_BASED_UNIT('INCH',{measure}) LENGTH_UNIT() NAMED_UNIT({dimensions}))")
    angle = add("(NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.))")
    solid_angle = add("(NAMED_UNIT(*) SI_UNIT($,.STERADIAN.) SOLID_ANGLE_UNIT())")
    uncertainty = add(f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-05),{length},'','')")
    context = add(
        "(GEOMETRIC_REPRESENTATION_CONTEXT(3) "
        f"GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({uncertainty})) "
        f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle},{solid_angle})) REPRESENTATION_CONTEXT('',''))"
    )
    shape = add(f"FACETED_BREP_SHAPE_REPRESENTATION('',({solid}),{context})")
    application = add("APPLICATION_CONTEXT('automotive design')")
    product_context = add(f"PRODUCT_CONTEXT('',{application},'mechanical')")
    product = add(f"PRODUCT('box','','',({product_context}))")
    formation = add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
    design = add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{application},'design')")
    definition = add(f"PRODUCT_DEFINITION('design','',{formation},{design})")
    product_shape = add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
    add(f"SHAPE_DEFINITION_REPRESENTATION({product_shape},{shape})")
    head = ["FILE_DESCRIPTION((''),'2;1');", "FILE_NAME('','',(''),(''),'','','');"]
    head.append("FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));")
    whole = ["ISO-10303-21;", "HEADER;", *head, "ENDSEC;", "DATA;", *lines, "ENDSEC;", "END-ISO-10303-21;"]
    return "\n".join(whole) + "\n"
