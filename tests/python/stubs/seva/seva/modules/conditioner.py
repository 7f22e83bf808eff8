import torch


class CLIPConditioner(torch.nn.Module):
    pass
