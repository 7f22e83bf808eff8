class DiscreteDenoiser:
    def __init__(self, num_idx=1000, device="cpu"):
        assert num_idx == 1000
