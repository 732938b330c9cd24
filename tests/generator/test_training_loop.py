"""The one training loop: what it asks for, in which order, and that Adam in it is torch's Adam."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from acp_lab.generator.training_loop import AdamOneCycle, Epoch, LossGradient, Training, batch_gradient

pytestmark = pytest.mark.usefixtures("one_torch_thread")


def test_epochs_batches_and_steps_come_in_turn() -> None:
    calls: list[str] = []

    def batches(epoch: int) -> list[float]:
        calls.append(f"epoch {epoch}")
        return [10.0 * epoch + 1.0, 10.0 * epoch + 3.0]

    def gradient(batch: float) -> LossGradient:
        calls.append(f"loss {batch:g}")
        return LossGradient(batch, (torch.tensor(batch),))

    training = Training(3, batches, gradient, lambda gradients: calls.append(f"step {gradients[0].item():g}"))
    run = training.run(first_epoch=1)
    assert next(run) == Epoch(2, 12.0)
    # Nothing of the next epoch happens before the caller asks for it: there it stores and shows the last one.
    assert calls == ["epoch 1", "loss 11", "step 11", "loss 13", "step 13"]
    assert list(run) == [Epoch(3, 22.0)]
    assert list(training.run(first_epoch=3)) == []


def test_adam_takes_the_steps_of_torchs_own_loop() -> None:
    inputs, truth = torch.linspace(-1.0, 1.0, 12).reshape(6, 2), torch.arange(6.0)[:, None]

    def network() -> torch.nn.Linear:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(2)
            return torch.nn.Linear(2, 1)

    def loss(model: torch.nn.Linear, batch: Tensor) -> Tensor:
        return (model(inputs[batch]) - truth[batch]).square().mean()

    plain = network()
    adam = torch.optim.Adam(plain.parameters(), lr=0.1)
    schedule = torch.optim.lr_scheduler.OneCycleLR(adam, 0.1, total_steps=9)
    for _ in range(3):
        for batch in torch.arange(6).split(2):
            adam.zero_grad()
            loss(plain, batch).backward()
            adam.step()
            schedule.step()

    model = network()
    optimiser = AdamOneCycle(model.parameters(), 0.1, steps=9)
    training = Training(
        3,
        lambda epoch: torch.arange(6).split(2),
        lambda batch: batch_gradient(loss(model, batch), optimiser.parameters),
        optimiser.step,
    )
    losses = [epoch.loss for epoch in training.run()]
    assert losses[-1] < losses[0]
    for one, other in zip(model.parameters(), plain.parameters(), strict=True):
        torch.testing.assert_close(one, other)  # rounded differently: fused
