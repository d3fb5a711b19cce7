"""Every Warp kernel compiles for CUDA, on machines without a GPU too: NVRTC needs none. It says nothing of results."""

import importlib
import pkgutil
from itertools import product
from pathlib import Path
from typing import get_args

import pytest
import warp as wp

import sixway
from sixway.extras.moments import generated as moments
from sixway.sim.flow import collision
from sixway.sim.flow.generated import air, edges
from sixway.sim.flow.lattice import CollisionModel, LatticeName, lattice_named

OLDEST, NEWEST = 75, 120
"""Compute capabilities (times 10), Turing and Blackwell: no kernel asks which one it runs on, so what compiles for both
compiles for those between them."""

STREAMINGS = get_args(air.Streaming)
MODULES = sorted(
    found.name for found in pkgutil.walk_packages(sixway.__path__, "sixway.") if found.name.endswith("kernels")
)


def compiled(module: object, folder: Path, *archs: int) -> list[Path]:
    """The PTX files of a module with kernels."""
    try:
        wp.compile_aot_module(module, arch=list(archs), module_dir=str(folder), use_ptx=True)
    except RuntimeError as error:
        if "NVRTC" in str(error) and "not" in str(error):
            pytest.skip(f"this build of Warp cannot compile CUDA: {error}")
        raise
    return sorted(folder.glob("*.ptx"))


@pytest.mark.parametrize("name", MODULES)
def test_a_module_of_kernels_compiles_for_cuda(name: str, tmp_path: Path) -> None:
    importlib.import_module(name)
    module = wp.get_module(name)
    if not any(True for _ in module.kernels):
        return  # functions for other modules' kernels, or kernels of Dr.Jit
    files = compiled(module, tmp_path, OLDEST, NEWEST)
    assert len(files) == 2
    text = files[0].read_text(errors="replace")
    assert text.count(".entry") >= len(module.kernels)


def generated() -> list[tuple[str, object]]:
    """All that the lattice step is made of, for every lattice, collision and streaming."""
    made: list[tuple[str, object]] = [
        ("step of moments", moments.collide_and_stream()),
        ("moments to populations", moments.expand()),
    ]
    for lattice in get_args(LatticeName):
        made.append((f"find_links {lattice}", edges.find_links(lattice)))
        for streaming in STREAMINGS:
            makers = (air.measure, air.fill, air.grow, edges.send, edges.exchange)
            made += [(f"{make.__name__} {lattice} {streaming}", make(lattice, streaming)) for make in makers]
    for lattice, model, streaming in product(get_args(LatticeName), get_args(CollisionModel), STREAMINGS):
        try:
            collision.text(lattice_named(lattice), model)
        except ValueError:
            continue  # a collision that this lattice cannot have
        made.append((f"step {lattice} {model} {streaming}", air.collide_and_stream(lattice, model, streaming)))
    return made


def test_every_generated_kernel_compiles_for_cuda(tmp_path: Path) -> None:
    kernels = generated()
    assert len({name for name, _ in kernels}) == len(kernels) > 25
    for number, (name, kernel) in enumerate(kernels):
        folder = tmp_path / str(number)
        folder.mkdir()
        files = compiled(kernel.module, folder, OLDEST, NEWEST)  # type: ignore[attr-defined]
        assert len(files) == 2 and ".entry" in files[0].read_text(errors="replace"), name
