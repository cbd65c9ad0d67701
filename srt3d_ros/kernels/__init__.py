"""The work that is done for every pixel: the contract, in torch, also for a GPU (`oracle`), and for the CPU (`cpu`)."""
