"""Quaternion functions against SciPy's, for one rotation or a thousand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.seeds import seed_of
from twin import rotation


@pytest.fixture(scope="module")
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    seed = seed_of(request)
    return np.random.default_rng(seed)


def random_quaternions(rng: np.random.Generator, n: int) -> np.ndarray:
    return rotation.normalized(rng.standard_normal((n, 4)))


def peer(q: np.ndarray) -> Rotation:
    return Rotation.from_quat(q, scalar_first=True)


def test_a_product_turns_as_one_turn_after_the_other(rng):
    a, b = random_quaternions(rng, 100), random_quaternions(rng, 100)
    product = rotation.multiply(a, b)
    np.testing.assert_allclose(
        rotation.matrix(product), rotation.matrix(a) @ rotation.matrix(b), atol=1e-14
    )
    np.testing.assert_allclose(rotation.multiply(a[0], b), rotation.multiply(a[:1], b), atol=0.0)


def test_rotate_and_matrix_are_scipys(rng):
    q, v = random_quaternions(rng, 100), rng.standard_normal((100, 3))
    np.testing.assert_allclose(rotation.rotate(q, v), peer(q).apply(v), atol=1e-14)
    np.testing.assert_allclose(rotation.matrix(q), peer(q).as_matrix(), atol=1e-14)


def test_the_conjugate_turns_back(rng):
    q, v = random_quaternions(rng, 100), rng.standard_normal((100, 3))
    back = rotation.rotate(rotation.conjugate(q), rotation.rotate(q, v))
    np.testing.assert_allclose(back, v, atol=1e-14)


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-8, 1e-4, 1.0, 3.14])
def test_rotation_vectors_go_there_and_back_at_every_size(rng, size):
    phi = rng.standard_normal((50, 3))
    phi *= size / np.linalg.norm(phi, axis=1, keepdims=True)
    q = rotation.from_rotation_vector(phi)
    np.testing.assert_allclose(q, Rotation.from_rotvec(phi).as_quat(scalar_first=True), atol=1e-15)
    np.testing.assert_allclose(rotation.to_rotation_vector(q), phi, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(rotation.to_rotation_vector(-q), phi, rtol=1e-12, atol=1e-15)


def test_euler_angles_are_intrinsic_z_y_x(rng):
    yaw, roll = rng.uniform(-3.1, 3.1, (2, 50))
    pitch = rng.uniform(-1.5, 1.5, 50)
    q = rotation.from_euler_zyx(yaw, pitch, roll)
    angles = np.stack([yaw, pitch, roll], axis=-1)
    np.testing.assert_allclose(
        rotation.matrix(q), Rotation.from_euler("ZYX", angles).as_matrix(), atol=1e-14
    )
    np.testing.assert_allclose(rotation.to_euler_zyx(q), angles, atol=1e-12)


def test_tilt_is_the_angle_between_the_bodys_axis_and_the_vertical(rng):
    q = random_quaternions(rng, 100)
    vertical = rotation.vertical_body(q)
    np.testing.assert_allclose(vertical, peer(q).as_matrix()[:, 2], atol=1e-14)
    np.testing.assert_allclose(np.cos(rotation.tilt(q)), vertical[:, 2], atol=1e-14)


def test_a_rows_bits_do_not_depend_on_how_many_rows_there_are(rng):
    a, b = random_quaternions(rng, 256), random_quaternions(rng, 256)
    phi = rng.standard_normal((256, 3))
    for function, arguments in (
        (rotation.multiply, (a, b)),
        (rotation.rotate, (a, phi)),
        (rotation.from_rotation_vector, (phi,)),
        (rotation.to_rotation_vector, (a,)),
    ):
        whole = function(*arguments)
        for count in (2, 3, 7, 64):
            part = function(*(argument[:count] for argument in arguments))
            assert np.array_equal(part, whole[:count]), function.__name__


def test_the_least_turn_takes_an_axis_to_the_same_place_without_turning_about_it(rng):
    axis = rotation.rotate(random_quaternions(rng, 1)[0], np.array([0.0, 0.0, 1.0]))
    turns = rng.uniform(-1.5, 1.5, (50, 3))
    least = rotation.least_turn(turns, axis)
    there = [Rotation.from_rotvec(turn).apply(axis) for turn in turns]
    np.testing.assert_allclose(Rotation.from_rotvec(least).apply(axis), there, atol=1e-12)
    np.testing.assert_allclose(least @ axis, 0.0, atol=1e-12)
    assert np.all(np.linalg.norm(least, axis=1) <= np.linalg.norm(turns, axis=1) + 1e-12)
