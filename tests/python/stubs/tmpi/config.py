tilesz_min = 64
padsz2tile_ratio = 0.125
imgsz_max = 320  # 1024 in truth
num_planes = 4
render_padsz = 16  # 128 in truth
