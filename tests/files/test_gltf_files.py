"""glTF as exporters and packers write it: the same chair comes out of all of them."""

import base64

import numpy as np
import pytest

from recon.files import gltf
from recon.files.recognise import Kind, recognise
from recon.files.shape_files import read_cloud, read_mesh
from recon.scene import InputError
from tests.shape_makers import BOXES, CHAIR, TRIANGLES, VERTICES, Gltf, assert_chair, corners

Y_UP = np.array([(1, 0, 0), (0, 0, 1), (0, -1, 0)])


def whole(file=None, **primitive):
    """A glTF with the chair as one mesh in one scene."""
    file = file or Gltf()
    file.tree["scenes"] = [{"nodes": [file.node(mesh=file.mesh(VERTICES, CHAIR, **primitive))]}]
    return file


def said(path):
    seen = recognise(path)
    assert seen.kind == Kind.MESH
    return seen.what


def test_boxes_placed_by_nodes_within_nodes(tmp_path):
    """Unit boxes under a node with scale and place, below a root that turns all; by TRS and by matrix."""
    file = Gltf()
    box = file.mesh(corners((-1, -1, -1), (1, 1, 1)), TRIANGLES)
    children = []
    for i, (low, high) in enumerate(BOXES):
        middle, half = (np.add(low, high) / 2).tolist(), (np.subtract(high, low) / 2).tolist()
        if i % 2:
            children.append(file.node(mesh=box, translation=middle, scale=half))
        else:
            pose = np.diag([*half, 1])
            pose[:3, 3] = middle
            children.append(file.node(mesh=box, matrix=pose.T.ravel().tolist()))
    root = file.node(children=children, rotation=[-np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    file.tree["scenes"] = [{"nodes": [root]}]
    path = file.glb(tmp_path / "a.bin")
    assert said(path) == "a mesh of 72 faces in 6 parts"
    assert_chair(read_mesh(path), Y_UP)


def test_instances_of_one_leg(tmp_path):
    """EXT_mesh_gpu_instancing: four legs out of one, turned by normalised quaternions of bytes that turn nothing."""
    file = Gltf()
    leg = file.mesh(corners((-0.02, -0.02, 0), (0.02, 0.02, 0.43)), TRIANGLES)
    middles = np.array([np.add(*box)[:2] / 2 for box in np.array(BOXES[:4])])
    places = file.accessor(np.column_stack([middles, np.zeros(4)]).astype("f4"))
    turns = file.accessor(np.array([(0, 0, 0, 127)] * 3 + [(0, 0, 0, -127)], "i1"), normalized=True)
    extension = {"attributes": {"TRANSLATION": places, "ROTATION": turns, "_ID": 99}}
    nodes = [file.node(mesh=leg, extensions={"EXT_mesh_gpu_instancing": extension})]
    nodes += [file.node(mesh=file.mesh(corners(*box), TRIANGLES)) for box in BOXES[4:]]
    file.tree.update(scenes=[{"nodes": nodes}], extensionsRequired=["EXT_mesh_gpu_instancing"])
    path = file.glb(tmp_path / "a.glb")
    assert said(path) == "a mesh of 72 faces in 6 parts"
    assert_chair(read_mesh(path))


@pytest.mark.parametrize(("kind", "normalized", "atol"), [("i2", True, 1e-4), ("u2", False, 1e-4), ("i1", True, 1e-2)])
def test_quantised_positions(tmp_path, kind, normalized, atol):
    """KHR_mesh_quantization: the node takes the numbers back to metres. A row has a stride of four bytes and more."""
    middle, half = (VERTICES.max(0) + VERTICES.min(0)) / 2, np.ptp(VERTICES, axis=0).max() / 2
    most = np.iinfo(kind).max
    units = (VERTICES - middle) / half
    if kind == "u2":
        numbers, scale, offset = (units + 1) / 2 * most, 2 * half / most, middle - half
    else:
        numbers, scale, offset = units * most, half if normalized else half / most, middle
    file, rows = Gltf(), np.zeros((len(VERTICES), 4), kind)
    rows[:, :3] = np.rint(numbers)
    view = file.view(rows.tobytes(), byteStride=rows.strides[0])
    places = file.accessor(rows[:, :3], bufferView=view, normalized=normalized)
    node = file.node(mesh=file.mesh(places, CHAIR), translation=offset.tolist(), scale=[float(scale)] * 3)
    file.tree.update(scenes=[{"nodes": [node]}], extensionsRequired=["KHR_mesh_quantization"])
    assert_chair(read_mesh(file.glb(tmp_path / "a.glb")), atol=atol)


def test_sparse_accessors(tmp_path):
    """All places are given as exceptions: from nothing, and from other places."""
    for base in (None, VERTICES * 0):
        file = Gltf()
        rows, values = (
            file.view(np.arange(len(VERTICES), dtype="u2").tobytes()),
            file.view(VERTICES.astype("f4").tobytes()),
        )
        sparse = {
            "count": len(VERTICES),
            "indices": {"bufferView": rows, "componentType": 5123},
            "values": {"bufferView": values},
        }
        more = {} if base is None else {"bufferView": file.view(base.astype("f4").tobytes())}
        places = file.accessor(VERTICES.astype("f4"), sparse=sparse, **more)
        file.tree["scenes"] = [{"nodes": [file.node(mesh=file.mesh(places, CHAIR))]}]
        assert_chair(read_mesh(file.glb(tmp_path / "a.glb")))


def test_draco(tmp_path):
    import DracoPy

    file = whole()
    packed = DracoPy.encode(VERTICES.astype("f4"), CHAIR.astype("u4"), quantization_bits=14)
    identity = DracoPy.decode(packed).attributes[0]["unique_id"]
    extension = {"bufferView": file.view(packed), "attributes": {"POSITION": identity}}
    file.tree["meshes"][0]["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": extension}
    for accessor in file.tree["accessors"]:
        del accessor["bufferView"]
    path = file.glb(tmp_path / "a.glb")
    assert said(path) == "a mesh of 72 faces in 1 part"
    assert_chair(read_mesh(path))


def test_what_is_packed_otherwise_is_refused_in_one_line(tmp_path):
    file = whole()
    for view in file.tree["bufferViews"]:
        view.update(buffer=1, extensions={"EXT_meshopt_compression": {"buffer": 0, "mode": "ATTRIBUTES"}})
    path = file.glb(
        tmp_path / "a.glb", {"byteLength": 9, "extensions": {"EXT_meshopt_compression": {"fallback": True}}}
    )
    with pytest.raises(InputError, match="packed with meshopt"):
        read_mesh(path)
    file = whole()
    file.tree["extensionsRequired"] = ["ACME_cubes"]
    del file.tree["accessors"][0]["bufferView"]
    with pytest.raises(InputError, match=r"packed in a way unknown here \(ACME_cubes\)"):
        read_mesh(file.glb(tmp_path / "c.glb"))


def test_buffers_beside_the_file(tmp_path):
    path = whole().gltf(tmp_path / "a.gltf", "my%20buffer.bin", tmp_path / "my buffer.bin")
    assert said(path) == "a mesh of 72 faces in 1 part"
    assert_chair(read_mesh(path))
    file = whole()
    (tmp_path / "sub").mkdir()
    assert_chair(read_mesh(file.gltf(tmp_path / "b.gltf", "sub/./50%25.bin", tmp_path / "sub" / "50%.bin")))
    uri = "data:application/octet-stream;base64," + base64.b64encode(file.data).decode()
    assert_chair(read_mesh(file.gltf(tmp_path / "c.gltf", uri)))


@pytest.mark.parametrize("uri", ["../secret.bin", "sub/../../secret.bin", "..%2Fsecret.bin", "{folder}/secret.bin"])
def test_buffers_outside_the_folder_are_not_followed(tmp_path, uri):
    inside = tmp_path / "inside"
    inside.mkdir()
    path = whole().gltf(inside / "a.gltf", uri.format(folder=tmp_path), tmp_path / "secret.bin")
    with pytest.raises(InputError, match=r"lies outside its folder and is not followed"):
        read_mesh(path)


def test_a_missing_buffer_and_an_address(tmp_path):
    with pytest.raises(InputError, match=r"needs my buffer\.bin, which is not beside it"):
        read_mesh(whole().gltf(tmp_path / "a.gltf", "my%20buffer.bin"))
    with pytest.raises(InputError, match="which is not followed"):
        read_mesh(whole().gltf(tmp_path / "a.gltf", "https://example.org/a.bin"))


def test_the_scene_that_the_file_opens_with(tmp_path):
    file = whole()
    other = file.node(mesh=file.mesh(corners((0, 0, 0), (9, 9, 9)), TRIANGLES))
    file.tree.update(scenes=[{"nodes": [other]}, {"nodes": [0]}, {}], scene=1)
    path = file.glb(tmp_path / "a.glb")
    assert said(path) == "a mesh of 72 faces in 1 part, 1 of 3 scenes"
    assert_chair(read_mesh(path))
    file.tree.update(scenes=[{}, {"nodes": [0]}], scene=0)
    assert_chair(read_mesh(file.glb(tmp_path / "empty first.glb")))
    del file.tree["scenes"], file.tree["scene"]
    assert said(file.glb(tmp_path / "none.glb")) == "a mesh of 84 faces in 2 parts"


def test_strips_fans_and_faces_without_indices(tmp_path):
    """Both quads' ways of being cut have the same two triangles' area."""
    quad = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], float)
    for mode, order in ((5, [0, 1, 2, 3]), (6, [0, 1, 3, 2])):
        file = Gltf()
        file.tree["scenes"] = [{"nodes": [file.node(mesh=file.mesh(quad, order, mode=mode))]}]
        surface = read_mesh(file.glb(tmp_path / "a.glb"))
        a, b, c = surface.vertices[surface.triangles].transpose(1, 0, 2)
        np.testing.assert_allclose(np.linalg.norm(np.cross(b - a, c - a), axis=1), (1, 1))
    file = Gltf()
    mesh = file.mesh(VERTICES[CHAIR].reshape(-1, 3), CHAIR)
    del file.tree["meshes"][mesh]["primitives"][0]["indices"]
    file.tree["scenes"] = [{"nodes": [file.node(mesh=mesh)]}]
    assert_chair(read_mesh(file.glb(tmp_path / "b.glb")))


def test_morph_targets_and_hidden_nodes_are_left_out(tmp_path):
    file = whole()
    file.tree["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": file.accessor(np.ones((48, 3), "f4"))}]
    file.tree["meshes"][0]["weights"] = [1]
    hidden = {"KHR_node_visibility": {"visible": False}}
    file.tree["scenes"][0]["nodes"].append(file.node(mesh=0, translation=[5, 0, 0], extensions=hidden))
    assert_chair(read_mesh(file.glb(tmp_path / "a.glb")))


def test_points_and_lines_are_a_cloud(tmp_path):
    path = whole(mode=0).glb(tmp_path / "a.glb")
    assert recognise(path) == gltf.Recognised(Kind.CLOUD, "a point cloud of 48 points (glTF without faces)")
    np.testing.assert_allclose(read_cloud(path), VERTICES, atol=1e-6)


def _circle(file):
    file.tree["nodes"][0]["children"] = [0]


def _doubling(file):
    for i in range(40):
        file.node(children=[i, i])
    file.tree["scenes"][0]["nodes"] = [len(file.tree["nodes"]) - 1]


def _beyond(file):
    file.tree["accessors"][0]["count"] = 10**6


def _claims(file):
    file.tree["accessors"][1]["count"] = 10**11


@pytest.mark.parametrize(
    ("harm", "reason"),
    [
        (_circle, "circle"),
        (_doubling, "more than 50,000 parts"),
        (_beyond, "beyond its buffer"),
        (_claims, "more than the 20,000,000 that are read"),
    ],
)
def test_damage_is_refused_with_a_reason(tmp_path, harm, reason):
    file = whole()
    harm(file)
    path = file.glb(tmp_path / "a.glb")
    with pytest.raises(InputError, match=reason):
        read_mesh(path if recognise(path).kind == Kind.MESH else tmp_path)


def test_old_versions(tmp_path):
    path = whole().glb(tmp_path / "a.glb")
    data = path.read_bytes()
    path.write_bytes(data[:4] + b"\1\0\0\0" + data[8:])
    with pytest.raises(InputError, match="version 1, only 2 is read here"):
        recognise(path)
