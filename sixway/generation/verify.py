"""Does the dataset on disk hold what it says? Every frame's hash, every EXR's pixels, every packed array."""

from sixway.core.exr import CorruptFrameError, read_exr
from sixway.core.progress import track
from sixway.core.store import inside, sha256_file
from sixway.data.manifest import read_manifest
from sixway.generation.stages import FLOW_CHANNELS, TARGET_CHANNELS, Generation, all_stores, channels_of
from sixway.volumes.limits import VolumeError
from sixway.volumes.npz import read_npz


def verify(job: Generation) -> list[str]:
    """Every problem found, one line each with its remedy; [] if the dataset is whole."""
    problems: list[str] = []
    files = [(store, store.path / name) for store, names in all_stores(job) for name in names]
    for store, path in track(files, total=len(files), label="verify"):
        record = store.record_of(path)
        if record is None:
            problems.append(f"{path}: this frame is missing; run the generation command again")
        elif sha256_file(path) != record["sha256"]:
            problems.append(
                f"{path}: its hash differs from the recorded one; delete it and run the generation command again"
            )
        else:
            try:
                if path.suffix == ".npz":
                    read_npz(path)
                else:
                    read_exr(path, channels_of(record, _channels(job, store.folder.path.partition("/")[0])))
            except (CorruptFrameError, VolumeError) as error:
                problems.append(str(error))
    try:
        manifest = read_manifest(job.out)
    except (FileNotFoundError, ValueError) as error:
        return [*problems, str(error)]
    for group in manifest.groups:
        for array in group.arrays.values():
            path = inside(job.out, array.path)
            if not path.is_file() or sha256_file(path) != array.sha256:
                problems.append(f"{path}: missing or altered; delete it and run the pack stage again")
    return problems


def mixed_folders(job: Generation) -> list[str]:
    """A line for every folder whose frames were made on several devices or by several methods: they differ by more
    than what they show."""
    lines = []
    for store, _ in all_stores(job):
        for fact in ("device", "method"):
            found = sorted({str(record[fact]) for record in store.done().values() if fact in record})
            if len(found) > 1:
                lines.append(f"{store.path}: frames of {len(found)} {fact}s, {' and '.join(found)}")
    return lines


def _channels(job: Generation, layer: str) -> tuple[str, ...]:
    match layer:
        case "target":
            return TARGET_CHANNELS
        case "flow":
            return FLOW_CHANNELS
        case _:
            return job.plan.config.guides[layer.removeprefix("guide_")].channels
