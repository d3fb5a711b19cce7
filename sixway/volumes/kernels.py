"""The one Warp kernel of this room: sparse NanoVDB to a dense box."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def densify(volume: wp.uint64, first: wp.vec3i, dense: wp.array3d(dtype=float)):
    """dense[z, y, x] = the voxel at index `first` + (x, y, z)."""
    k, j, i = wp.tid()
    dense[k, j, i] = wp.volume_lookup_f(volume, first[0] + i, first[1] + j, first[2] + k)
