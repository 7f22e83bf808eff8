import argparse


def get_parser():
    parser = argparse.ArgumentParser()
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--ckpt_path", default="./checkpoints/model.ckpt")
    parser.add_argument("--config", default="./configs/inference_pvd_1024.yaml")
    parser.add_argument("--model_path", default="./checkpoints/DUSt3R_ViTLarge_BaseDecoder_512_dpt.pth")
    parser.add_argument("--height", type=int, default=576)
    parser.add_argument("--width", type=int, default=1024)
    parser.add_argument("--video_length", type=int, default=25)
    parser.add_argument("--seed", type=int, default=123)
    return parser
