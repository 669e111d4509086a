"""What a program of `torch.export` says of itself: its graph, and the tensors that lie beside it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AliasChoices, AliasPath, Field, model_validator

from tmca.attributes import Attributes

Size = Annotated[int, Field(ge=0, le=2**40)]
Type = Literal[1, 2, 3, 4, 5, 6, 7, 8, 10, 11, 12, 13]


class GraphName(Attributes):
    name: str


class GraphDevice(Attributes):
    type: Literal["cpu"]


class GraphArgument(Attributes):
    """One argument; the field that is stated says what it is."""

    as_tensor: GraphName | None = None
    as_tensors: tuple[GraphName, ...] | None = None
    as_int: int | None = None
    as_ints: tuple[int, ...] | None = None
    as_float: float | None = None
    as_floats: tuple[float, ...] | None = None
    as_bool: bool | None = None
    as_string: Literal["cpu", "none", "tanh", "constant", "replicate", "reflect", "circular"] | None = None
    as_scalar_type: Type | None = None
    as_memory_format: Literal[1, 2, 4] | None = None
    as_layout: Literal[7] | None = None
    as_device: GraphDevice | None = None
    as_none: bool | None = None
    as_graph: Graph | None = Field(None, validation_alias=AliasPath("as_graph", "graph"))

    @model_validator(mode="after")
    def _one(self) -> GraphArgument:
        if len(self.model_fields_set) != 1:
            raise ValueError("an argument of a known kind")
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Of the tensors that it is."""
        return tuple(one.name for one in ([self.as_tensor] if self.as_tensor else self.as_tensors or ()))


class GraphInput(Attributes):
    name: str
    arg: GraphArgument
    kind: Literal[1, 2] = 1


class GraphNode(Attributes):
    target: str
    inputs: tuple[GraphInput, ...]
    outputs: tuple[GraphArgument, ...]


class GraphLength(Attributes):
    as_int: Size


class GraphMeta(Attributes):
    """Of a tensor."""

    dtype: Type
    sizes: tuple[GraphLength, ...]
    strides: tuple[GraphLength, ...]
    storage_offset: GraphLength
    layout: Literal[7]


class Graph(Attributes):
    inputs: tuple[GraphArgument, ...]
    outputs: tuple[GraphArgument, ...] = Field(min_length=1)
    nodes: tuple[GraphNode, ...]
    tensor_values: dict[str, GraphMeta] = Field(default_factory=dict)


class GraphStored(Attributes):
    name: str = Field(validation_alias=AliasPath("arg", "name"))
    stored: str = Field(validation_alias=AliasChoices("parameter_name", "buffer_name", "tensor_constant_name"))


class GraphSpec(Attributes):
    """Where an input of the graph comes from: a tensor of the file, or the user."""

    tensor: GraphStored | None = Field(None, validation_alias=AliasChoices("parameter", "buffer", "tensor_constant"))
    given: GraphArgument | None = Field(None, validation_alias=AliasPath("user_input", "arg"))


class GraphProgram(Attributes):
    graph: Graph = Field(validation_alias=AliasPath("graph_module", "graph"))
    inputs: tuple[GraphSpec, ...] = Field(validation_alias=AliasPath("graph_module", "signature", "input_specs"))


class GraphPayload(Attributes):
    path_name: str
    use_pickle: Literal[False]
    tensor_meta: GraphMeta


class GraphConfig(Attributes):
    config: dict[str, GraphPayload]
