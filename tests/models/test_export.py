"""The net as engines read it: plain operators at opset 15, one file, the same numbers in ONNX Runtime."""

import io

import numpy as np
import onnx
import onnxruntime
import pytest
import torch

from sixway.core.conventions import DIRECTIONS
from sixway.models.unet import SixWayUNet, UNetConfig

PLAIN_OPERATORS = {
    *("Conv", "Concat", "Add", "Mul", "Div", "Sub", "Sigmoid", "Relu", "LeakyRelu", "Slice", "Pad", "Clip"),
    *("ReduceMean", "GlobalAveragePool", "AveragePool", "Sqrt", "Pow", "DepthToSpace", "Identity", "Constant"),
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("size", [(32, 48), (35, 46)], ids=["multiple of the stride", "needs padding"])
@pytest.mark.parametrize(
    "channels",
    [(*DIRECTIONS, "transmittance", "depth", "emissive"), ("in_scatter", "transmittance", "depth")],
    ids=["six lights and fire", "paper"],
)
def test_onnx_at_opset_15(channels: tuple[str, ...], size: tuple[int, int]) -> None:
    torch.manual_seed(11)
    net = SixWayUNet(UNetConfig(), guide_channels=channels, guide_scale=1.3, emissive_scale=0.2).eval()
    with torch.no_grad():
        for parameter in net.parameters():
            parameter.add_(0.02 * torch.randn_like(parameter))
    guide = torch.rand(1, len(channels), *size)

    file = io.BytesIO()
    torch.onnx.export(
        net, (guide,), file, dynamo=False, opset_version=15, input_names=["guide"], output_names=["lightmap"]
    )
    model = onnx.load_from_string(file.getvalue())
    onnx.checker.check_model(model, full_check=True)

    assert [(imported.domain, imported.version) for imported in model.opset_import] == [("", 15)]
    assert {node.op_type for node in model.graph.node} <= PLAIN_OPERATORS
    assert not any(tensor.external_data for tensor in model.graph.initializer)
    assert [d.dim_value for d in model.graph.output[0].type.tensor_type.shape.dim] == [1, 8, *size]

    session = onnxruntime.InferenceSession(file.getvalue(), providers=["CPUExecutionProvider"])
    (exported,) = session.run(None, {"guide": guide.numpy()})
    np.testing.assert_allclose(exported, net(guide).detach().numpy(), rtol=0.0, atol=1e-4)
