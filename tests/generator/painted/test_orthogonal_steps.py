"""The optimiser: what it makes of a matrix, and that it finds minima."""

from __future__ import annotations

import pytest
import torch

from acp_lab.generator.painted.orthogonal_steps import OrthogonalSteps, orthogonalised

pytestmark = pytest.mark.usefixtures("one_torch_thread")


@pytest.mark.parametrize("shape", [(5, 5), (4, 9), (9, 4), (1, 7)])
def test_singular_values_go_near_one_and_directions_stay(shape: tuple[int, int]) -> None:
    torch.manual_seed(0)
    rows = min(shape)
    u, _, v = torch.linalg.svd(torch.randn(shape, dtype=torch.float64), full_matrices=False)
    given = u @ torch.diag(torch.linspace(1.0, 0.2, rows, dtype=torch.float64)) @ v
    made = orthogonalised(given)
    assert made.shape == shape
    inner = u.T @ made @ v.T
    torch.testing.assert_close(inner, torch.diag(inner.diagonal()), atol=1e-6, rtol=0.0)
    assert 0.6 < float(inner.diagonal().min()) <= float(inner.diagonal().max()) < 1.3


def test_a_least_squares_fit_is_found() -> None:
    torch.manual_seed(0)
    layer, goal = torch.nn.Linear(6, 4), torch.nn.Linear(6, 4)
    inputs = torch.randn(200, 6) * torch.tensor([10.0, 5.0, 1.0, 1.0, 0.3, 0.1])
    steps = OrthogonalSteps(layer.parameters())
    for k in range(150):
        loss = (layer(inputs) - goal(inputs)).square().mean()
        steps.step(torch.autograd.grad(loss, steps.parameters), 0.1 * (1.0 - k / 150))
    assert steps.count == 150
    assert float((layer.weight - goal.weight).detach().abs().max()) < 0.1
    assert float((layer.bias - goal.bias).detach().abs().max()) < 0.05


def test_convolutions_are_taken_as_matrices() -> None:
    torch.manual_seed(0)
    convolution = torch.nn.Conv2d(3, 5, 3)
    before = convolution.weight.detach().clone()
    steps = OrthogonalSteps(convolution.parameters())
    loss = convolution(torch.randn(2, 3, 6, 6)).square().mean()
    steps.step(torch.autograd.grad(loss, steps.parameters), 0.1)
    moved = (before - convolution.weight.detach()).reshape(5, -1)
    values = torch.linalg.svdvals(moved / 0.1)
    assert 0.5 < float(values.min()) <= float(values.max()) < 1.4


def test_the_polynomial_is_that_of_the_method() -> None:
    torch.manual_seed(0)
    made = wide = torch.randn(4, 9, dtype=torch.float64)
    made = made / (wide.norm() + 1e-7)
    for _ in range(5):
        gram = made @ made.T
        made = 3.4445 * made + (-4.7750 * gram + 2.0315 * gram @ gram) @ made
    torch.testing.assert_close(orthogonalised(wide), made, rtol=1e-9, atol=1e-9)


def test_all_of_it_happens_on_the_device_of_the_parameters() -> None:
    """Shown by a device without memory, which every machine has: tensors of the CPU cannot be mixed with its own."""
    for shape in ((4, 9), (9, 4)):
        layer = torch.nn.Linear(*shape, device="meta")
        steps = OrthogonalSteps(layer.parameters())
        loss = layer(torch.randn(7, shape[0], device="meta")).square().mean()
        steps.step(torch.autograd.grad(loss, steps.parameters), 0.1)
        assert {state.device.type for state in (*steps.first, *steps.second)} == {"meta"}
