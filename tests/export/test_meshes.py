"""Fields and isosurfaces in VTK and in mesh files."""

import json
import re
from contextlib import contextmanager
from importlib import import_module

import jax.numpy as jnp
import numpy as np
import pytest
from PIL import Image
from splines import catmull_rom
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import mutable

from contourfair_jax import cli, export
from contourfair_jax.io import Grid, InputError
from contourfair_jax.isosurface._mesh import edges_of, merged

READERS = {
    ".vtp": ("vtkIOXML", "vtkXMLPolyDataReader"),
    ".ply": ("vtkIOPLY", "vtkPLYReader"),
    ".stl": ("vtkIOGeometry", "vtkSTLReader"),
    ".obj": ("vtkIOGeometry", "vtkOBJReader"),
}


@pytest.fixture(scope="module")
def ball():
    x = np.linspace(-1, 1, 7)
    samples = x[:, None, None] ** 2 + 0.8 * x[:, None] ** 2 + 0.6 * x**2
    return catmull_rom(samples, 2 / 6, -1.0).isosurface(0.413, 0.1)


def back(path):
    """Points, triangles and point data of a mesh file."""
    module, name = READERS[path.suffix]
    reader = getattr(import_module(f"vtkmodules.{module}"), name)()
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    triangles = vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return vtk_to_numpy(data.GetPoints().GetData()), triangles, data.GetPointData()


def signed_volume(points, triangles):
    return np.linalg.det(points.astype(float)[triangles]).sum() / 6


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(5, 6), (4, 5, 3)])
def test_vtk_evaluates_the_field(shape):
    rng = np.random.default_rng(0)
    field = catmull_rom(rng.normal(size=shape), 0.5, 2.0)
    grid = field.to_vtk()
    cells = np.array(list(np.ndindex(*(n - 1 for n in shape))))
    assert grid.GetNumberOfCells() == len(cells)
    found, places = [], []
    values = vtk_to_numpy(grid.GetPointData().GetScalars())
    for number in range(len(cells)):
        cell, local = grid.GetCell(number), np.zeros(3)
        local[: len(shape)] = rng.random(len(shape))
        place, weights = [0.0] * 3, [0.0] * cell.GetNumberOfPoints()
        cell.EvaluateLocation(mutable(0), local.tolist(), place, weights)
        ids = [cell.GetPointId(k) for k in range(cell.GetNumberOfPoints())]
        found.append(np.dot(weights, values[ids]))
        places.append(place[: len(shape)])
        expected = 2.0 + 0.5 * (cells[number] + local[: len(shape)])
        np.testing.assert_allclose(place[: len(shape)], expected, atol=1e-12)
    np.testing.assert_allclose(found, field(jnp.asarray(places)), atol=1e-6)


def test_cells_without_values_are_left_out_of_vtk():
    samples = np.random.default_rng(0).normal(size=(6, 6))
    samples[0, 0] = np.nan
    field = catmull_rom(samples)
    expected = np.isfinite(np.asarray(field.bounds()[0])).sum()
    assert field.to_vtk().GetNumberOfCells() == expected < 25


@pytest.mark.parametrize("suffix", READERS)
def test_files_hold_the_mesh(suffix, ball, tmp_path):
    path = tmp_path / f"mesh{suffix}"
    notes = export.write_mesh(path, ball)
    points, triangles, _ = back(path)
    assert len(triangles) == len(ball.triangles)
    assert (len(points) == len(ball.vertices)) or suffix == ".stl"
    assert signed_volume(points, triangles) == pytest.approx(ball.volume, rel=1e-5)
    assert bool(notes) == (suffix in (".ply", ".stl"))
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", READERS)
@pytest.mark.parametrize("origin", [0.0, 1e4])
def test_files_hold_no_triangle_whose_corners_are_one(suffix, origin, tmp_path):
    x = np.arange(6) - 2.5
    inside = x[:, None, None] ** 2 + x[:, None] ** 2 + x**2 < 4
    mesh = catmull_rom(255.0 * inside, 1.0, origin).isosurface(127.5, 0.1)
    notes = export.write_mesh(tmp_path / f"mesh{suffix}", mesh)
    points, triangles, _ = back(tmp_path / f"mesh{suffix}")
    same, number = np.unique(points, axis=0, return_inverse=True)
    welded = number.reshape(-1)[triangles]
    assert (welded != np.roll(welded, -1, axis=1)).all()
    for corners in (triangles, welded):
        assert (edges_of(corners).faces == 2).all()
    assert len(same) == len(points)
    assert len(same) - len(edges_of(triangles).ends) + len(triangles) == 2
    assert signed_volume(points - origin, triangles) == pytest.approx(mesh.volume, rel=1e-3)
    gone = len(mesh.triangles) - len(triangles)
    assert bool(gone) == (suffix in (".ply", ".stl"))
    assert any(f"rounds their corners to one: {gone}" in note for note in notes) == bool(gone)


def test_opposite_triangles_are_taken_out_in_pairs():
    turns = [[0, 1, 2], [1, 0, 2], [2, 0, 1], [1, 2, 0], [3, 2, 1], [3, 4, 5], [3, 4, 5]]
    triangles = np.array([*turns, [6, 7, 5]])
    places = np.eye(8)[:, :3] + np.arange(8)[:, None]
    places[7] = places[6]
    kept, left = merged(places, triangles)
    # Three of the first four are alike; one of these goes with the fourth, and the last is a line.
    assert kept[left].tolist() == [turns[0], turns[2], *turns[4:]]


@pytest.mark.parametrize("suffix", [".vtp", ".ply", ".obj"])
def test_files_keep_normals(suffix, ball, tmp_path, capfd):
    export.write_mesh(tmp_path / f"mesh{suffix}", ball)
    _, _, data = back(tmp_path / f"mesh{suffix}")
    np.testing.assert_allclose(vtk_to_numpy(data.GetNormals()), ball.normals, atol=1e-5)
    assert capfd.readouterr().err == ""


def test_vtp_keeps_digits_normals_and_curvatures(ball, tmp_path):
    export.write_mesh(tmp_path / "mesh.vtp", ball)
    points, triangles, data = back(tmp_path / "mesh.vtp")
    np.testing.assert_array_equal(points, ball.vertices)
    np.testing.assert_array_equal(triangles, ball.triangles)
    np.testing.assert_array_equal(vtk_to_numpy(data.GetNormals()), ball.normals)
    for name in ("mean_curvature", "gaussian_curvature"):
        np.testing.assert_array_equal(vtk_to_numpy(data.GetArray(name)), getattr(ball, name))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_world_coordinates_keep_the_orientation(sign, ball, tmp_path):
    affine = np.diag([2.0, 3.0 * sign, 1.0, 1.0])
    affine[:3, 3] = 10.0, 20.0, 30.0
    grid = Grid(np.zeros((7, 7, 7)), spacing=(1 / 3,) * 3, origin=(-1.0,) * 3, affine=affine)
    export.write_mesh(tmp_path / "mesh.vtp", ball, grid)
    points, triangles, data = back(tmp_path / "mesh.vtp")
    np.testing.assert_allclose(points, grid.world(ball.vertices)[:, ::-1])
    middle = points.mean(0)
    a, b, c = np.moveaxis(points[triangles] - middle, 1, 0)
    outward = np.cross(b - a, c - a)
    normals = vtk_to_numpy(data.GetNormals())
    assert ((outward * normals[triangles].sum(1)).sum(1) > 0).all()
    assert ((points - middle) * normals).sum(1).min() > 0
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1)


def test_bad_meshes_and_names(ball, tmp_path):
    with pytest.raises(InputError, match="must end in"):
        export.write_mesh(tmp_path / "mesh.glb", ball)
    with pytest.raises(InputError, match="no folder"):
        export.write_mesh(tmp_path / "none" / "mesh.ply", ball)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", READERS)
def test_a_mesh_without_triangles_is_a_file(suffix, tmp_path):
    path = tmp_path / f"mesh{suffix}"
    export.write_mesh(path, catmull_rom(np.zeros((4, 4, 4))).isosurface(1.0))
    points, triangles, _ = back(path)
    assert (len(points), len(triangles)) == (0, 0)


# The command line ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scan(tmp_path_factory):
    """A ball of larger values, and the corner sample missing."""
    x = np.linspace(-1, 1, 5)
    path = tmp_path_factory.mktemp("scan") / "scan.npy"
    np.save(path, 3.0 - (x[:, None, None] ** 2 + x[:, None] ** 2 + x**2))
    return path


def call(capsys, *arguments):
    code = cli.main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.mark.slow
def test_isosurface_command(scan, tmp_path, capsys):
    target, picture = tmp_path / "mesh.vtp", tmp_path / "mesh.png"
    code, out, err = call(
        capsys, "isosurface", scan, "--level", 2.5, "-o", target, "--plot", picture
    )
    assert code == 0, err
    assert "watertight" in out
    points, triangles, _ = back(target)
    assert f"{len(points)} vertices, {len(triangles)} triangles" in out
    image = np.asarray(Image.open(picture).convert("L"))
    assert len(np.unique(image)) > 30


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--level", "nan", "-o", "mesh.vtp"), "levels must be finite"),
        (("--level", "1", "-o", "mesh.xyz"), "must end in"),
        (("--level", "1", "-o", "mesh.vtp", "--plot", "mesh.pdf"), "must end in"),
        (("--level", "1", "-o", "mesh.vtp", "--tolerance", "0"), "tolerance must be"),
        (("-o", "mesh.vtp"), "--level"),
    ],
)
def test_isosurface_command_refuses(scan, tmp_path, capsys, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    code, _, err = call(capsys, "isosurface", scan, *arguments)
    assert code == 2
    assert message in err.splitlines()[-1]
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("suffix", READERS)
def test_isosurface_command_at_a_level_outside_the_range(suffix, scan, tmp_path, capsys):
    target, picture = tmp_path / f"mesh{suffix}", tmp_path / "mesh.png"
    options = ("--level", 99, "-o", target, "--plot", picture)
    code, out, err = call(capsys, "isosurface", scan, *options)
    assert code == 0
    assert "0 triangles, empty" in out
    assert "note: the field has no surface at level 99" in err
    assert len(back(target)[1]) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    code, out, _ = call(capsys, "isosurface", scan, *options, "--json")
    found = json.loads(out)
    assert (code, found["triangles"], found["unproved"]) == (0, 0, 0)
    assert "the field has no surface at level 99" in found["notes"]


def test_isosurface_command_refuses_images(tmp_path, capsys):
    np.save(tmp_path / "flat.npy", np.eye(5))
    code, _, err = call(
        capsys, "isosurface", tmp_path / "flat.npy", "--level", 1, "-o", tmp_path / "mesh.vtp"
    )
    assert code == 2
    assert "3-D data is needed" in err


@pytest.mark.slow
def test_metrics_command(scan, tmp_path, capsys):
    picture = tmp_path / "metrics.png"
    code, out, _ = call(capsys, "metrics", scan, "--levels", "2,2.5", "--plot", picture)
    rows = [line.split() for line in out.splitlines()]
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert [row[0] for row in rows[5:]] == ["trilinear:", "fair:", "fair,"]
    assert code == 0
    assert rows[0] == ["level", "field", "area", "bending/4pi", "parts", "Euler"]
    assert [row[:2] for row in rows[1:5]] == [
        ["2", "trilinear"], ["2", "fair"], ["2.5", "trilinear"], ["2.5", "fair"]
    ]  # fmt: skip
    assert [float(x) for x in rows[4][2:]] == pytest.approx([8 * np.pi, 1, 1, 2], rel=0.15)
    assert float(rows[3][3]) > float(rows[4][3])  # the kinks of the trilinear one are counted
    assert re.search("integrated over all levels.* area .* value × length², bending/4pi", out)
    np.save(tmp_path / "flat.npy", np.load(scan)[2])
    code, out, _ = call(capsys, "metrics", tmp_path / "flat.npy", "--count", 2)
    rows = [line.split() for line in out.splitlines()]
    assert code == 0
    assert rows[1][1] == "bilinear"
    assert [row[0] for row in rows[5:7]] == ["bilinear:", "fair:"]
    code, out, _ = call(capsys, "metrics", tmp_path / "flat.npy", "--count", 2, "--json")
    found = json.loads(out)
    assert len(found["table"]["fair"]) == len(found["levels"]) == 2
    assert found["whole"]["fair"]["slope jump"] < 1e-6 < found["whole"]["bilinear"]["slope jump"]
    assert len(found["changes"]) == len(rows) - 8


@pytest.mark.slow
@pytest.mark.parametrize("ndim", [2, 3])
def test_metrics_command_counts_its_steps(scan, ndim, tmp_path, monkeypatch, capsys):
    moves = []

    @contextmanager
    def working(reporter, text):
        yield lambda *move: moves.append(move)

    monkeypatch.setattr("contourfair_jax.cli._console.Reporter.working", working)
    np.save(tmp_path / "in.npy", np.load(scan)[2] if ndim == 2 else np.load(scan))
    assert call(capsys, "metrics", tmp_path / "in.npy", "--count", 2)[0] == 0
    assert moves == [(k + 1, 6) for k in range(6)]


@pytest.mark.slow
def test_metrics_command_leaves_the_same_cells_out(tmp_path, capsys):
    x = np.linspace(-1, 1, 12)
    plane = x[:, None] + 0.5 * x
    plane[5, 5] = np.nan
    np.save(tmp_path / "plane.npy", plane)
    code, out, _ = call(capsys, "metrics", tmp_path / "plane.npy", "--levels", "0,0.3", "--json")
    found = json.loads(out)
    assert code == 0
    plain, fair = ([row["length"] for row in found["table"][k]] for k in ("bilinear", "fair"))
    assert plain == pytest.approx(fair, rel=1e-6)
    assert found["changes"] == []


@pytest.mark.slow
def test_adaptive_command(scan, tmp_path, capsys):
    target = tmp_path / "leaves.vtu"
    code, out, _ = call(capsys, "adaptive", scan, "--tolerance", 0.05, "-o", target)
    assert code == 0
    reader = import_module("vtkmodules.vtkIOXML").vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(target))
    reader.Update()
    assert f"{reader.GetOutput().GetNumberOfCells()} leaves" in out
    flat, picture = tmp_path / "flat.npy", tmp_path / "leaves.png"
    np.save(flat, np.load(scan)[2])
    for source in (scan, flat):
        options = ("--tolerance", 0.05, "-o", target, "--plot", picture, "--json")
        code, out, _ = call(capsys, "adaptive", source, *options)
        assert code == 0
        assert json.loads(out)["error"] <= 0.05
        assert picture.read_bytes().startswith(b"\x89PNG")
    code, _, err = call(capsys, "adaptive", scan, "--tolerance", 0, "-o", tmp_path / "no.vtu")
    assert code == 2
    assert "tolerance must be above zero" in err
