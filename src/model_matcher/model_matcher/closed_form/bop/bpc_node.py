"""bpc_node: answers the bin-picking challenge's service get_pose_estimates, where its messages are installed."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from msgs_py.node_runtime.config import Config, parameter
from msgs_py.node_runtime.runtime import GraphNode, run_node
from stereo_recovery.pipeline import compile_steps as recovery_steps

from ...pipeline import compile_steps
from .answer import load_models
from .bpc_requests import PACKAGE, answer_request, challenge_messages

NO_MESSAGES = (
    f'{PACKAGE} is not installed: build it in the workspace of the challenge and source that. Without it the nodes '
    "recovery_node and matcher_node with cameras:=3 do the same on topics, and 'bop' on folders"
)


@dataclass(frozen=True)
class EstimatorConfig(Config):
    """Parameters of bpc_node."""

    model_dir: str = parameter(
        '', 'Folder of the models: obj_000001.ply (millimetres), .csg or .npz, ...', read_only=True
    )


class EstimatorNode(GraphNode[EstimatorConfig]):
    """Answers one request after the other.

    Raises
    ------
    ValueError
        ibpc_interfaces is not installed, or the models cannot be used.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('bpc_node', EstimatorConfig, **kwargs)
        try:
            messages = challenge_messages()
            if messages is None:
                raise ValueError(NO_MESSAGES)
            self._models = load_models(Path(self.config.model_dir))
        except ValueError:
            self.destroy_node()
            raise
        self._estimate_type = messages[0].PoseEstimate
        self.create_service(messages[1].GetPoseEstimates, 'get_pose_estimates', self._on_request)
        self.start()

    def configure(self) -> None:
        """Compile."""
        self.prepare((*recovery_steps(), *compile_steps(n_models=len(self._models), images=True)))

    def report_values(self) -> dict[str, object]:
        """What diagnostics say besides the counters."""
        return {'objects': ', '.join(map(str, sorted(self._models)))}

    async def _on_request(self, request: Any, response: Any) -> Any:
        """Answer; of a request that cannot be used nothing, and why in the log and the diagnostics."""
        if not self.active:
            self.problem(f'get_pose_estimates: bpc_node is {self.lifecycle}')
            return response
        await self.prepared()
        self.attempt('get_pose_estimates', self._answer, request, response)
        return response

    def _answer(self, request: Any, response: Any) -> None:
        response.pose_estimates = answer_request(request, self._models, self._estimate_type)
        self.done()


def main(args: list[str] | None = None) -> int:
    """Run the node until it is told to stop; the exit status, 2 when it cannot serve."""
    try:
        return run_node(EstimatorNode, args)
    except ValueError as error:
        print(f'bpc_node: {error}', file=sys.stderr)
        return 2


if __name__ == '__main__':
    raise SystemExit(main())
