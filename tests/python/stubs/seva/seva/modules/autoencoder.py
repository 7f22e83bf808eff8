import torch


class AutoEncoder(torch.nn.Module):
    def __init__(self, chunk_size=None):
        super().__init__()
