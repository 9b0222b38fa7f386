import torch

from transferkit import wrap
from transferkit.streams import Streams

IDP = "InvertedDoublePendulum-v5"


def test_the_paper_sandwich_has_the_papers_parameters_and_layers(paper_core, specs):
    """PPOPT on InvertedDoublePendulum: 17,476 parameters; layers recomputed by hand here."""
    policy = wrap(paper_core, specs[IDP], preset="paper")
    assert sum(p.numel() for p in policy.parameters()) == 17_476
    observation = torch.randn(5, 9, generator=Streams(0).torch("x"))
    x = torch.relu(policy.input_finetune(policy.input_adapter(observation)))
    h = torch.relu(policy.core.body[2](torch.relu(policy.core.body[0](x))))
    mean = policy.mean_adapter(torch.relu(policy.output_finetune(policy.core.mean_head(h))))
    std = torch.relu(policy.output_finetune(policy.core.log_std_head(h).exp()))
    assert torch.allclose(policy(observation)[0], mean)
    assert torch.allclose(policy(observation)[1], policy.std_adapter(torch.log(std + 1e-6)))
