"""Damaged, truncated and lying files: one clear line, bounded memory, nothing else."""

from __future__ import annotations

import gzip
import io
import random
import resource
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path

import nibabel
import numpy as np
import pytest
import SimpleITK
import tifffile
from dicom_files import series
from expected_skips import third_party_data
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from volillum_addon.core.errors import InputError
from volillum_addon.readers.formats import format_of, import_volume, read_volume

VALUES = (np.arange(4 * 5 * 6, dtype=np.int16) * 7).reshape((6, 5, 4))
# Nothing here needs more than this many bytes of voxels; a header that lies must not either.
MOST_BYTES = 64e6
# Nor may OpenVDB, whose memory Python does not see, take what the machine has.
MOST_ADDRESSES = 16 << 30


def itk(name: str, compressed: bool = False) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        path = folder / name
        image = SimpleITK.GetImageFromArray(VALUES)
        SimpleITK.WriteImage(image, str(path), useCompression=compressed)
        return path

    return make


def tiff(compression: str | None) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        path = folder / "a.tif"
        tifffile.imwrite(path, VALUES, imagej=True, metadata={"spacing": 2.0, "unit": "um"},
                         compression=compression)  # fmt: skip
        return path

    return make


def ome(folder: Path) -> Path:
    tifffile.imwrite(folder / "a.ome.tif", VALUES, ome=True, photometric="minisblack", metadata={
        "axes": "ZYX", "PhysicalSizeX": 0.1, "PhysicalSizeY": 0.2, "PhysicalSizeZ": 3})  # fmt: skip
    return folder / "a.ome.tif"


def dicom(folder: Path) -> Path:
    series(folder)
    return sorted(folder.iterdir())[0]


def numpy(folder: Path) -> Path:
    np.save(folder / "a.npy", VALUES)
    return folder / "a.npy"


def npz(folder: Path) -> Path:
    np.savez_compressed(folder / "a.npz", a=VALUES)
    return folder / "a.npz"


def sidecar(folder: Path) -> Path:
    (folder / "a.raw").write_bytes(VALUES.tobytes())
    (folder / "a.raw.json").write_text('{"dims": [4, 5, 6], "type": "int16", "spacing": [1,2,3]}')
    return folder / "a.raw"


def vtkjs(folder: Path) -> Path:
    (folder / "x.gz").write_bytes(gzip.compress(VALUES.tobytes()))
    (folder / "index.json").write_text(
        '{"origin":[0,0,0],"spacing":[1,1,2],"extent":[0,3,0,4,0,5],"pointData":{"arrays":[{"data":'
        '{"numberOfComponents":1,"dataType":"Int16Array","ref":{"encode":"LittleEndian",'
        '"basepath":"data","id":"x"}}}]}}'
    )
    return folder / "index.json"


def slc(folder: Path) -> Path:
    data = b"11111\n4 5 6 8\n1 1 2\n1 6 0 1\n2 1 X" + bytes(6)
    for k in range(6):
        runs = bytes([0x80 | 10, *range(10), 10, k, 0])
        data += f"{len(runs)} X".encode() + runs
    (folder / "a.slc").write_bytes(data)
    return folder / "a.slc"


def den(folder: Path) -> Path:
    box = [0, 0, 0, 3, 4, 5, 4, 5, 6]
    head = np.array([1, *box, *box, *box, 0], "<i2").tobytes() + np.array(120, "<i4").tobytes()
    (folder / "a.den").write_bytes(head + bytes(range(120)))
    return folder / "a.den"


def cloud(folder: Path) -> Path:
    (folder / "a.txt").write_text(
        "# a cloud\n4,5,6 # sizes\n0.02,0.02\n0.1,0.2,0.3,0.4,0.5,0.6\n# i,j,k,lwc,reff\n"
        "0,1,2,0.5,10.0\n3,4,5,0.25,12.5\n"
    )
    return folder / "a.txt"


def vdb(folder: Path) -> Path:
    import_volume(sidecar(folder), folder / "b.vdb")
    return folder / "b.vdb"


MAKERS: dict[str, Callable[[Path], Path]] = {
    "nii": itk("a.nii"),
    "nii.gz": itk("a.nii.gz"),
    "hdr": itk("a.hdr"),
    "nrrd": itk("a.nrrd"),
    "nrrd gzip": itk("a.nrrd", True),
    "nhdr": itk("a.nhdr"),
    "mha": itk("a.mha"),
    "mha packed": itk("a.mha", True),
    "mhd": itk("a.mhd"),
    "tif": tiff(None),
    "tif packed": tiff("zlib"),
    "ome": ome,
    "dicom": dicom,
    "npy": numpy,
    "npz": npz,
    "raw": sidecar,
    "vtkjs": vtkjs,
    "slc": slc,
    "den": den,
    "cloud": cloud,
    "vdb": vdb,
}


@pytest.fixture(autouse=True)
def _bounded() -> Iterator[None]:
    """An allocation of terabytes fails here instead of succeeding on paper."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    most = MOST_ADDRESSES if hard == resource.RLIM_INFINITY else min(hard, MOST_ADDRESSES)
    resource.setrlimit(resource.RLIMIT_AS, (most, hard))
    yield
    resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def read_or_refuse(path: Path) -> bool:
    """Whether the file could be read; anything but an InputError is a fault. The result is small,
    and refusing took no memory either."""
    lines = 0
    tracemalloc.start()
    try:
        grid, about = read_volume(path)
        assert np.all(np.isfinite(grid.values))
        assert about.shape == grid.shape
        done = True
    except InputError as error:
        done = False
        lines = str(error).count("\n")
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert lines == 0
    assert peak < MOST_BYTES
    return done


@pytest.mark.parametrize("name", MAKERS)
def test_whole_files_are_read(tmp_path: Path, name: str) -> None:
    assert read_or_refuse(MAKERS[name](tmp_path))


@pytest.mark.parametrize("name", MAKERS)
def test_every_file_of_a_volume_may_be_cut_anywhere(tmp_path: Path, name: str) -> None:
    path = MAKERS[name](tmp_path)
    cut = 0
    for file in [path] if name == "dicom" else sorted(tmp_path.iterdir()):
        whole = file.read_bytes()
        places = {0, 1, 4, len(whole) // 3, len(whole) // 2, len(whole) - 1}
        for end in sorted(places):
            file.write_bytes(whole[:end])
            cut += not read_or_refuse(path)
        file.write_bytes(whole)
    # A last byte may not matter (of a text, a trailer); half a file always does.
    assert cut >= 4
    assert read_or_refuse(path)


def test_a_header_longer_than_its_file_is_not_allocated(tmp_path: Path) -> None:
    path = MAKERS["npy"](tmp_path)
    whole = path.read_bytes()
    # Version 3 has four bytes for the header's length; here they claim 660 MB.
    path.write_bytes(whole[:6] + b"\x03\x00v\x00{'" + whole[12:])
    assert not read_or_refuse(path)


@pytest.mark.parametrize("name", MAKERS)
@settings(max_examples=120, deadline=None,
          suppress_health_check=[HealthCheck.function_scoped_fixture])  # fmt: skip
@given(seed=st.integers(0, 2**32), count=st.integers(1, 8), head=st.booleans())
def test_bytes_may_be_anything(
    tmp_path: Path, name: str, seed: int, count: int, head: bool
) -> None:
    folder = tmp_path / "made"
    if not folder.exists():
        folder.mkdir()
        MAKERS[name](folder)
    files = sorted(folder.iterdir())
    rng = random.Random(seed)
    chosen = rng.choice(files)
    whole = chosen.read_bytes()
    path = _of(folder, name)
    damaged = bytearray(whole)
    for _ in range(count):
        place = rng.randrange(min(len(damaged), 400) if head else len(damaged))
        match rng.randrange(4):
            case 0:
                damaged[place] ^= 1 << rng.randrange(8)
            case 1:
                damaged[place] = rng.choice(b"\x00\xff\x7f\x80-9 e\n")
            case 2:
                del damaged[place : place + rng.randrange(1, 9)]
            case _:
                damaged[place:place] = rng.choice(
                    [b"9", b"-", b"999999999", b"\xff\xff\xff\x7f", b"nan", b"0", b"1e300"]
                )
        if not damaged:
            break
    chosen.write_bytes(damaged)
    try:
        read_or_refuse(path)
    finally:
        chosen.write_bytes(whole)


def _of(folder: Path, name: str) -> Path:
    """The file that stands for the volume."""
    headers = (".nhdr", ".mhd", ".hdr", ".vdb", ".raw")
    files = sorted(folder.iterdir())
    if name == "vtkjs":
        return folder / "index.json"
    return next((file for file in files if file.suffix in headers and
                 (name != "vdb" or file.suffix == ".vdb")), files[0])  # fmt: skip


LIES = {
    "nii": lambda whole: whole[:42] + np.array([32767] * 3, "<i2").tobytes() + whole[48:],
    "nrrd": lambda whole: whole.replace(b"sizes: 4 5 6", b"sizes: 90000 90000 90000"),
    "nrrd gzip": lambda whole: whole.replace(b"sizes: 4 5 6", b"sizes: 9000 9000 9000"),
    "mha": lambda whole: whole.replace(b"DimSize = 4 5 6", b"DimSize = 99999 99999 99999"),
    "mha packed": lambda whole: whole.replace(b"DimSize = 4 5 6", b"DimSize = 9999 9999 9999"),
    "slc": lambda whole: whole.replace(b"4 5 6 8", b"9999 9999 9999 8"),
    "npy": lambda whole: whole.replace(b"(6, 5, 4), }", b"(99999, 99999, 99999), }")[:-15],
    "cloud": lambda whole: whole.replace(b"4,5,6 #", b"9999,9999,6 #"),
}


@pytest.mark.parametrize("name", LIES)
def test_a_header_that_lies_about_its_sizes(tmp_path: Path, name: str) -> None:
    path = MAKERS[name](tmp_path)
    whole = path.read_bytes()
    lying = LIES[name](whole)
    assert lying != whole
    path.write_bytes(lying)
    assert not read_or_refuse(path)


def test_a_gzip_bomb_is_unpacked_only_as_far_as_its_header_goes(tmp_path: Path) -> None:
    packed = io.BytesIO()
    with gzip.GzipFile(fileobj=packed, mode="wb") as file:
        for _ in range(512):
            file.write(bytes(1 << 20))
    header = b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 5 6\nencoding: gzip\n\n"
    (tmp_path / "bomb.nrrd").write_bytes(header + packed.getvalue())
    assert read_or_refuse(tmp_path / "bomb.nrrd")


def test_a_header_names_no_file_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "secret.raw").write_bytes(bytes(120))
    folder = tmp_path / "inside"
    folder.mkdir()
    for place in ("../secret.raw", str(tmp_path / "secret.raw")):
        (folder / "a.nhdr").write_text(
            "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 5 6\nencoding: raw\n"
            f"data file: {place}\n"
        )
        (folder / "a.mhd").write_text(
            f"NDims = 3\nDimSize = 4 5 6\nElementType = MET_UCHAR\nElementDataFile = {place}\n"
        )
        for name in ("a.nhdr", "a.mhd"):
            with pytest.raises(InputError, match="a file beside the header"):
                read_volume(folder / name)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_voxels_that_are_no_numbers_are_counted(tmp_path: Path, value: float) -> None:
    values = np.ones((3, 4, 5), np.float32)
    values[1, 2, 3] = value
    np.save(tmp_path / "a.npy", values)
    with pytest.raises(InputError, match=r"1 (NaN|infinite) voxel, first at \(1, 2, 3\)"):
        read_volume(tmp_path / "a.npy")


def test_a_double_that_no_float_holds_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.full((2, 2, 2), 1e300))
    with pytest.raises(InputError, match="a float32"):
        read_volume(tmp_path / "a.npy")


def test_complex_numbers_are_refused(tmp_path: Path) -> None:
    nibabel.Nifti1Image(np.ones((3, 3, 3), np.complex64), np.eye(4)).to_filename(tmp_path / "a.nii")
    with pytest.raises(InputError, match="complex64; expected integers or floats"):
        read_volume(tmp_path / "a.nii")


def test_files_of_no_known_format_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.xyz").write_bytes(b"anything")
    with pytest.raises(InputError, match=r"no known format; expected one of .*\.nii"):
        format_of(tmp_path / "a.xyz")


@pytest.mark.parametrize(
    "name", ["pelvis_ct/example_ct.nii.gz", "tooth_ct/tooth.raw", "flybrain_confocal/flybrain.tif"]
)
def test_real_files_cut_in_half(tmp_path: Path, name: str) -> None:
    source = third_party_data(name)
    for file in source.parent.iterdir():
        data = file.read_bytes()
        (tmp_path / file.name).write_bytes(data[: len(data) // 2] if file == source else data)
    header = tmp_path / source.name.replace(".raw", ".nhdr")
    with pytest.raises(InputError, match=source.name):
        import_volume(header, tmp_path / "out.vdb")
    assert not list(tmp_path.glob("*.vdb"))
