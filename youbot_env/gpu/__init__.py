"""The batch on a GPU: its own source compiled for CUDA, by numba-cuda (extra ``gpu``)."""

from youbot_env.gpu.batch import GpuBatch

__all__ = ["GpuBatch"]
