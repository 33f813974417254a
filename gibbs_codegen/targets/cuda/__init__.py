"""CUDA: functions of a device, and kernels with one thread a state."""
