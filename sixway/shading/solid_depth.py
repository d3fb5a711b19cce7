"""How far a picture's rays go until they meet a solid: what hides smoke, and seen from a light, what shadows it."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from sixway.core.frames import Camera
from sixway.core.solids import Box, Cylinder, Mesh, Solid, Sphere
from sixway.shading.surface import project

Rays = Float[np.ndarray, "h w 3"]
Distance = Float[np.ndarray, "h w"]


def solid_depth(solids: Sequence[Solid], camera: Camera) -> Distance:
    """Metres along each ray of `camera` to the first solid ahead, float64; infinite where there is none."""
    origins, towards = camera.rays()
    nearest = np.full(origins.shape[:2], np.inf)
    for solid in solids:
        match solid:
            case Sphere():
                depth = _to_sphere(solid, origins, towards)
            case Box():
                depth = _to_box(solid, origins, towards)
            case Cylinder():
                depth = _to_cylinder(solid, origins, towards)
            case Mesh():
                depth = _to_mesh(solid, camera, origins, towards)
        nearest = np.minimum(nearest, depth)
    return nearest


def bounding_sphere(solid: Solid) -> tuple[Float[np.ndarray, "3"], float]:
    """A centre and a radius [m] that hold the solid."""
    match solid:
        case Sphere():
            return np.array(solid.centre_m), solid.radius_m
        case Box():
            return np.array(solid.centre_m), 0.5 * float(np.linalg.norm(solid.size_m))
        case Cylinder():
            start, end = np.array(solid.start_m), np.array(solid.end_m)
            return 0.5 * (start + end), float(np.hypot(0.5 * np.linalg.norm(end - start), solid.radius_m))
        case Mesh():
            low, high = solid.corners_m.min(axis=0), solid.corners_m.max(axis=0)
            return 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))


def _between(enter: Distance, leave: Distance) -> Distance:
    """First point ahead of an interval on the ray; the origin itself if that lies inside."""
    return np.where((enter <= leave) & (leave > 0.0), np.maximum(enter, 0.0), np.inf)


def _to_sphere(sphere: Sphere, origins: Rays, towards: Rays) -> Distance:
    offset = origins - np.array(sphere.centre_m)
    middle = -(offset * towards).sum(axis=-1)
    half_square = middle**2 - (offset**2).sum(axis=-1) + sphere.radius_m**2
    half = np.sqrt(np.maximum(half_square, 0.0))
    return np.where(half_square > 0.0, _between(middle - half, middle + half), np.inf)


def _slab(offset: Distance, slope: Distance, half: float) -> tuple[Distance, Distance]:
    """Where a ray is within +-half of a coordinate that starts at `offset` and grows by `slope` a metre."""
    slope = np.where(np.abs(slope) < 1e-12, 1e-12, slope)
    one, two = (-half - offset) / slope, (half - offset) / slope
    return np.minimum(one, two), np.maximum(one, two)


def _to_box(box: Box, origins: Rays, towards: Rays) -> Distance:
    offset = origins - np.array(box.centre_m)
    slabs = [_slab(offset[..., axis], towards[..., axis], 0.5 * box.size_m[axis]) for axis in range(3)]
    return _between(np.maximum.reduce([enter for enter, _ in slabs]), np.minimum.reduce([leave for _, leave in slabs]))


def _to_cylinder(cylinder: Cylinder, origins: Rays, towards: Rays) -> Distance:
    """Where a ray is within the endless cylinder and between its two ends."""
    start, end = np.array(cylinder.start_m), np.array(cylinder.end_m)
    length = float(np.linalg.norm(end - start))
    axis = (end - start) / length
    offset = origins - 0.5 * (start + end)
    along, slope = offset @ axis, towards @ axis
    enter, leave = _slab(along, slope, 0.5 * length)
    aside, drift = offset - along[..., None] * axis, towards - slope[..., None] * axis
    speed = np.maximum((drift**2).sum(axis=-1), 1e-12)
    middle = -(aside * drift).sum(axis=-1) / speed
    half_square = middle**2 - ((aside**2).sum(axis=-1) - cylinder.radius_m**2) / speed
    half = np.sqrt(np.maximum(half_square, 0.0))
    depth = _between(np.maximum(enter, middle - half), np.minimum(leave, middle + half))
    return np.where(half_square > 0.0, depth, np.inf)


def _to_mesh(mesh: Mesh, camera: Camera, origins: Rays, towards: Rays) -> Distance:
    """Each triangle asks the rays inside its bounds in the picture (Moeller, Trumbore 1997)."""
    nearest = np.full(origins.shape[:2], np.inf)
    pixels, depth = project(camera, mesh.corners_m)
    whole = np.array([[0, 0], [camera.width_px, camera.height_px]])
    for face in mesh.faces:
        a, b, c = mesh.corners_m[face]
        bounds = whole  # a triangle that reaches behind a pinhole has no bounds in its picture
        if camera.kind == "orthographic" or (depth[face] > 0.0).all():
            low, high = pixels[face].min(axis=0) - 0.5, pixels[face].max(axis=0) + 0.5
            bounds = np.clip(np.array([np.floor(low), np.ceil(high)]), 0, whole[1]).astype(int)
        window = (slice(bounds[0, 1], bounds[1, 1]), slice(bounds[0, 0], bounds[1, 0]))
        origin, ray = origins[window], towards[window]
        if not ray.size:
            continue
        ab, ac = b - a, c - a
        across = np.cross(ray, ac)
        volume = across @ ab
        inverse = 1.0 / np.where(np.abs(volume) < 1e-30, np.inf, volume)
        offset = origin - a
        turned = np.cross(offset, ab)
        u, v = (across * offset).sum(axis=-1) * inverse, (ray * turned).sum(axis=-1) * inverse
        distance = (turned @ ac) * inverse
        hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (distance > 0.0) & (volume != 0.0)
        nearest[window] = np.where(hit, np.minimum(nearest[window], distance), nearest[window])
    return nearest
