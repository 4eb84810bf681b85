#!/usr/bin/env python3
"""A descriptor network of our own: trained on pictures of other dates, judged on places that it never saw, against
oriented gradients.

usage: ./run bench own-network train DATA --out FILE [--network small|large|coarse] [--seconds S]
       ./run bench own-network judge FILE... [--data DIR] [--share N]

train  DATA/PLACE/*: pictures of one place, pixel on pixel, from other dates or sensors (jpg, png, tif; any channels);
       DATA/*: pictures alone. What was used in November 2026, all of it free to use: NAIP 2010, 2012, 2014, 2016, 2017
       and 2019 of opengeos/data with near infrared, its western 2.6 km (public domain); orthophotos and photos of
       OpenDroneMap's odm_data_aukerman, _zoo, _garfield_msp and _seneca (CC0); ground and map of simulated worlds
       (`nadir simulate world`, seeds 9101 to 9104). Takes ten minutes on a large GPU.
judge  looks at fengyuan, arroio (both maps), gearth_pairs and NAIP (other years, eastern part) of DIR, positions
       unknown within 70 to 100 m: right; clean: right and less ambiguous than every wrong one.

A look in training: a template of 96 px, a window of 160 px of another picture of the same place, turned, scaled and
moved a little. The network describes both, the template is correlated as the matcher does it (means removed, over all
channels), and the softmax over all its places in the window and in three windows of other places shall be at the true
one. Every picture gets its own mix of channels, tone curve by brightness, light, shadows, blur, noise and changed parts.

Needs PyTorch, OpenCV, NumPy and SciPy for Python; rasterio and pyproj to judge.
"""
import argparse
import csv
import math
import pathlib
import random
import sys
import time

try:
    import cv2
    import numpy
    import torch
    from scipy import fft
    from torch import nn
    from torch.nn import functional
except ImportError as missing:
    print(f"NOT RUN: {missing}; NADIR_BENCH_VENV with torch, opencv-python-headless, numpy, scipy, rasterio, pyproj")
    sys.exit(0)

TEMPLATE_PX, WINDOW_PX, MARGIN_PX = 96, 160, 8


# ---- what is compared


def smoothed(x, sigma):
    if sigma < 0.1:
        return x
    reach, channels = max(1, int(3 * sigma + 0.5)), x.shape[1]
    t = torch.arange(-reach, reach + 1, device=x.device, dtype=x.dtype)
    kernel = torch.exp(-t * t / 2 / sigma**2)
    kernel = kernel / kernel.sum()
    x = functional.pad(x, (reach, reach, 0, 0), mode="replicate")
    x = functional.conv2d(x, kernel.view(1, 1, 1, -1).expand(channels, 1, 1, -1), groups=channels)
    x = functional.pad(x, (0, 0, reach, reach), mode="replicate")
    return functional.conv2d(x, kernel.view(1, 1, -1, 1).expand(channels, 1, -1, 1), groups=channels)


class Network(nn.Module):
    """Grey of 0 to 1 as (B, 1, H, W) to descriptors of length 1 as (B, C, H / stride, W / stride)."""

    LAYERS = {  # channels, side of the kernel, stride, dilation
        "small": [(16, 5, 2, 1), (24, 3, 1, 1), (24, 3, 1, 2), (32, 3, 1, 1), (12, 1, 1, 1)],
        "large": [(24, 5, 2, 1), (40, 3, 1, 1), (40, 3, 1, 2), (40, 3, 1, 2), (40, 3, 1, 1), (12, 1, 1, 1)],
        "coarse": [(16, 5, 2, 1), (32, 3, 2, 1), (40, 3, 1, 1), (40, 3, 1, 1), (40, 3, 1, 1), (16, 1, 1, 1)],
    }

    def __init__(self, name):
        super().__init__()
        layers, before, self.stride, self.margin_px = [], 1, 1, 12
        for channels, side, stride, dilation in self.LAYERS[name]:
            layers += [nn.Conv2d(before, channels, side, stride, dilation * (side // 2), dilation), nn.ReLU()]
            before, self.stride = channels, self.stride * stride
        self.layers = nn.Sequential(*layers[:-1])
        self.log_sharpness = nn.Parameter(torch.tensor(3.4))

    def forward(self, grey):
        box = lambda x: functional.avg_pool2d(functional.pad(x, (7, 7, 7, 7), mode="replicate"), 15, 1)
        mean = box(grey)
        variance = (box(grey * grey) - mean * mean).clamp(min=0)
        x = (grey - mean) / (variance.sqrt() + 0.5 * variance.mean((2, 3), keepdim=True).sqrt() + 1e-3)
        x = self.layers(x)
        return x / (x.pow(2).sum(1, keepdim=True) + 0.05).sqrt()


class OrientedGradients(nn.Module):
    """The six orientations of libgeo/vision/oriented_channels.hpp."""

    stride, margin_px = 1, 4

    def forward(self, grey):
        grey = functional.pad(smoothed(grey * 255, 1.0), (1, 1, 1, 1), mode="replicate")
        sobel = torch.tensor([[-1, 0, 1], [-2, 0, 2], [-1, 0, 1.0]], device=grey.device) / 8
        x, y = (functional.conv2d(grey, kernel.reshape(1, 1, 3, 3)) for kernel in (sobel, sobel.t()))
        strength, angle = (x * x + y * y).sqrt(), torch.atan2(y, x)
        strength = strength / (smoothed(strength, 2.0) + 0.35 * strength.mean((2, 3), keepdim=True) + 1e-3)
        channels = [strength * torch.cos(2 * (angle - k * math.pi / 6)).clamp(min=0) ** 2 for k in range(6)]
        return smoothed(torch.cat(channels, 1), 1.0)


def load(path):
    if path == "oriented-gradients":
        return OrientedGradients()
    stored = torch.load(path)
    network = Network(stored["network"])
    network.load_state_dict(stored["state"])
    return network.eval()


# ---- training


def scores_of_batch(templates, windows, others):
    """Correlations of each template with its own window, and with those of `others` more places."""
    height, width = templates.shape[2:]
    rows, columns = windows.shape[2:]
    count = height * width
    templates = templates - templates.mean((2, 3), keepdim=True)
    norm = templates.pow(2).sum((1, 2, 3)).clamp(min=1e-9).sqrt()
    spectra = torch.fft.rfft2(templates, s=(rows, columns)).conj(), torch.fft.rfft2(windows)
    box = lambda x: functional.avg_pool2d(x, (height, width), 1) * count
    energy = (box(windows.pow(2)) - box(windows).pow(2) / count).sum(1).clamp(min=1e-6).sqrt()
    for shift in range(others + 1):
        products = (spectra[0] * spectra[1].roll(shift, 0)).sum(1)
        scores = torch.fft.irfft2(products, s=(rows, columns))[:, : rows - height + 1, : columns - width + 1]
        yield scores / (norm[:, None, None] * energy.roll(shift, 0))


class Looks:
    """Templates and windows of the places in a folder, as different as two dates are."""

    def __init__(self, folder, device, seed):
        self.random, self.device, self.reduced = random.Random(seed), device, {}
        torch.manual_seed(seed)
        self.places = [self.views(sorted(p.iterdir()) if p.is_dir() else [p]) for p in sorted(folder.iterdir())]
        self.dates = [views for views in self.places if len(views) > 1]
        self.alone = [views for views in self.places if len(views) == 1]

    def views(self, files):
        pictures = [cv2.imread(str(file), cv2.IMREAD_UNCHANGED) for file in files]
        pictures = [p if p.ndim == 3 else p[:, :, None] for p in pictures]
        return [torch.from_numpy(p).to(self.device).permute(2, 0, 1).float() / 255 for p in pictures]

    def cut(self, picture, x, y, scale, turn, side):
        channels, height, width = picture.shape
        c, s = math.cos(turn) * scale * side, math.sin(turn) * scale * side
        affine = torch.tensor([[c / width, -s / width, 2 * x / width - 1], [s / height, c / height, 2 * y / height - 1]])
        grid = functional.affine_grid(affine[None].to(self.device), (1, channels, side, side), align_corners=False)
        window = min(int(scale + 0.5), 4) // 2 * 2 + 1 if scale > 1.3 else 1
        key = id(picture), window
        if key not in self.reduced:
            self.reduced[key] = functional.avg_pool2d(picture[None], window, 1, window // 2)
        return functional.grid_sample(self.reduced[key], grid, padding_mode="reflection", align_corners=False)[0]

    def grey(self, picture):
        channels, draw = picture.shape[0], self.random.random()
        weights = [0.11, 0.59, 0.30][:channels] + [0.0] * (channels - 3)
        if draw > 0.55:
            weights = [self.random.gauss(0, 1) if draw > 0.85 else abs(self.random.gauss(0, 1)) for _ in range(channels)]
        weights = torch.tensor(weights, device=self.device) / (sum(map(abs, weights)) + 1e-6)
        return (picture * weights[:, None, None]).sum(0, keepdim=True)

    def batch(self, count):
        """Templates, windows, and where in its window each template's middle lies, from the window's middle in px."""
        draw, templates, windows, offsets = self.random, [], [], []
        for _ in range(count):
            views = draw.choice(self.dates if self.dates and (draw.random() < 0.65 or not self.alone) else self.alone)
            first, second = draw.choice(views), draw.choice(views)
            height, width = first.shape[1:]
            most = max(0.8, min(4.0, min(height, width) / 370))
            scale, turn = math.exp(draw.uniform(math.log(0.6 if most < 2 else 0.8), math.log(most))), draw.uniform(0, 7)
            room = min(WINDOW_PX * scale / 2, 0.42 * min(height, width))
            x, y = draw.uniform(room, width - room), draw.uniform(room, height - room)
            dx, dy = draw.uniform(-30, 30), draw.uniform(-30, 30)
            c, s = math.cos(turn) * scale, math.sin(turn) * scale
            windows.append(self.grey(self.cut(second, x, y, scale, turn, WINDOW_PX)))
            template_scale, template_turn = scale * math.exp(draw.gauss(0, 0.025)), turn + draw.gauss(0, 0.03)
            middle = x + c * dx - s * dy, y + s * dx + c * dy
            templates.append(self.grey(self.cut(first, *middle, template_scale, template_turn, TEMPLATE_PX)))
            offsets.append((dx, dy))
        changed = [self.another_day(self.changed(torch.stack(x), share)) for x, share in ((templates, 0.25), (windows, 0.35))]
        return *changed, torch.tensor(offsets, device=self.device)

    def blobs(self, like, cell):
        few = torch.randn(like.shape[0], 1, like.shape[-1] // cell, like.shape[-1] // cell, device=self.device)
        return functional.interpolate(few, size=like.shape[-2:], mode="bicubic", align_corners=False)

    def drawn(self, like, *more):
        return torch.rand(like.shape[0], *(more or (1, 1, 1)), device=self.device)

    def changed(self, x, share):
        mask = (self.blobs(x, self.random.choice([16, 32, 48])) > 0.3 + 1.5 * self.drawn(x)).float()
        mask = smoothed(mask, 0.6) * (self.drawn(x) < share)
        return x * (1 - mask) + x.roll(1, 0) * mask

    def another_day(self, x):
        def stretched(x):
            low, high = x.amin((2, 3), keepdim=True), x.amax((2, 3), keepdim=True)
            return (x - low) / (high - low + 1e-3)

        x, nodes = stretched(x), 10
        curve = torch.randn(x.shape[0], nodes, device=self.device) * 0.35 * (self.drawn(x, 1) < 0.6)
        tone = smoothed(x, 2.0).clamp(0, 1) * (nodes - 1)
        node = tone.floor().clamp(0, nodes - 2).long()
        share, node = (tone - node).flatten(1), node.flatten(1)
        x = x + ((1 - share) * curve.gather(1, node) + share * curve.gather(1, node + 1)).view_as(x)
        x = x * (1 + 0.5 * self.blobs(x, 32).clamp(-1, 1) * (self.drawn(x) < 0.3))
        shadow = (self.blobs(x, self.random.choice([6, 12, 24])) > 1).float() * (self.drawn(x) < 0.35)
        x = x * (1 - 0.6 * self.drawn(x) * smoothed(shadow, 0.7))
        x = stretched(smoothed(x, self.random.choice([0, self.random.uniform(0, 1.6)])))
        x = x.clamp(0, 1).pow(torch.exp(0.4 * torch.randn(x.shape[0], 1, 1, 1, device=self.device)))
        contrast = torch.exp(-2.2 * self.drawn(x))
        x = x * contrast + self.drawn(x) * (1 - contrast)
        x = x + torch.randn_like(x) * contrast * 0.12 * self.drawn(x).pow(2)
        return (x.clamp(0, 1) * 255).round() / 255


def train(options):
    device = "cuda" if torch.cuda.is_available() else "cpu"
    looks = Looks(options.folder, device, options.seed)
    network = Network(options.network).to(device)
    optimizer = torch.optim.AdamW(network.parameters(), lr=3e-3, weight_decay=1e-4)
    margin, begun, steps, share_right = MARGIN_PX // network.stride, time.time(), 0, 0.0
    print(f"{sum(p.numel() for p in network.parameters())} parameters, {len(looks.places)} places, on {device}")
    while (done := (time.time() - begun) / options.seconds) < 1:
        for group in optimizer.param_groups:
            group["lr"] = 3e-3 * min(1, (steps + 1) / 200) * (0.5 + 0.5 * math.cos(math.pi * done) + 0.005)
        with torch.no_grad():
            templates, windows, offset = looks.batch(options.batch)
        inner = network(templates)[:, :, margin:-margin, margin:-margin]
        maps = torch.stack(list(scores_of_batch(inner, network(windows), 3)), 1)
        side = maps.shape[-1]
        at = (offset + (WINDOW_PX - TEMPLATE_PX) / 2) / network.stride + margin
        places = torch.arange(side, device=device).float()
        bump = [torch.exp(-((places[None] - at[:, axis, None]) ** 2) / (2 * 0.8**2)) for axis in (0, 1)]
        target = (bump[1][:, :, None] * bump[0][:, None, :]).flatten(1)
        target = target / target.sum(1, keepdim=True).clamp(min=1e-6)
        logits = maps.flatten(1) * network.log_sharpness.exp()
        loss = -(target * functional.log_softmax(logits, 1)[:, : side * side]).sum(1).mean()
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        best = logits.detach().argmax(1)
        near = ((best % side - at[:, 0]).abs() < 3) & ((best // side - at[:, 1]).abs() < 3) & (best < side * side)
        share_right, steps = 0.98 * share_right + 0.02 * near.float().mean().item(), steps + 1
        if steps % 200 == 0:
            print(f"{100 * done:3.0f} %, step {steps}: loss {loss.item():.2f}, right {share_right:.2f}", flush=True)
    torch.save({"network": options.network, "state": network.cpu().state_dict()}, options.out)


# ---- judging


def rows(path):
    return list(csv.DictReader(line for line in path.open() if not line.startswith("#")))


def looks_of_flight(folder, map_file, draw, gsd_m=0.5, reach_m=100):
    import pyproj
    import rasterio

    dataset = rasterio.open(map_file)
    bands = dataset.read([1, 2, 3]) if dataset.count >= 3 else dataset.read([1])
    grey = cv2.cvtColor(numpy.ascontiguousarray(bands.transpose(1, 2, 0)), cv2.COLOR_RGB2GRAY) if len(bands) == 3 else bands[0]
    to_map = pyproj.Transformer.from_crs(4326, dataset.crs, always_xy=True)
    lens = dict(line.split("#")[0].split(":") for line in (folder / "camera.yaml").open() if line.split("#")[0].count(":") == 1)
    telemetry = {row["frame"]: row for row in rows(folder / "telemetry.csv")}
    forward_m, turned_deg = (19, 1.7) if folder.name == "fengyuan" else (0, 0)  # of the picture's centre; the set's README
    for row in rows(folder / "truth.csv"):
        state, lon, lat = telemetry[row["frame"]], float(row["lon_deg"]), float(row["lat_deg"])
        heading = math.radians(float(state["heading_deg"]) + turned_deg)
        metres = (111320 * math.cos(math.radians(lat)), 110800) if dataset.crs.is_geographic else (1, 1)
        picture = cv2.imread(str(folder / "frames" / row["frame"]), cv2.IMREAD_GRAYSCALE)
        scale = float(state["agl_m"]) * int(lens["width"]) / (float(lens["fx"]) * picture.shape[1] * gsd_m)
        picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        east, north = (draw.uniform(-0.7, 0.7) * reach_m for _ in range(2))
        side = int(2 * (reach_m + 6) / gsd_m + math.hypot(*picture.shape)) // 8 * 8
        column, line = ~dataset.transform * tuple(numpy.add(to_map.transform(lon, lat), (east / metres[0], north / metres[1])))
        step = gsd_m / abs(dataset.transform.a) / metres[0], gsd_m / abs(dataset.transform.e) / metres[1]
        source = cv2.GaussianBlur(grey, (0, 0), 0.5 * step[0]) if step[0] > 1 else grey
        warp = numpy.array([[step[0], 0, column - step[0] * side / 2], [0, step[1], line - step[1] * side / 2]])
        window = cv2.warpAffine(source, warp, (side, side), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
        truth = side / 2 + (forward_m * math.sin(heading) - east) / gsd_m, side / 2 - (forward_m * math.cos(heading) - north) / gsd_m
        templates = []
        for turn in (-5, -1.5, 1.5, 5):
            for size in (0.94, 1, 1.06):
                inside = int(int(min(picture.shape) * 0.95) * 0.72) // 8 * 8
                c, s = (f(heading + math.radians(turn)) / size for f in (math.cos, math.sin))
                turned = numpy.array([[c, s, 0], [-s, c, 0]])
                turned[:, 2] = numpy.array(picture.shape[::-1]) / 2 - turned[:, :2].sum(1) * inside / 2
                flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
                templates.append(cv2.warpAffine(picture, turned, (inside, inside), flags=flags, borderMode=cv2.BORDER_REPLICATE))
        yield templates, window, truth, gsd_m, 30 if forward_m else 20


def looks_of_years(folder, draw, count=160, side=80, window_px=152, east_from=540):
    import rasterio

    years = [cv2.cvtColor(rasterio.open(file).read([1, 2, 3]).transpose(1, 2, 0), cv2.COLOR_RGB2GRAY) for file in sorted(folder.glob("*.tif"))]
    height, width = (min(size) for size in zip(*(year.shape for year in years)))
    for _ in range(count):
        first, second = draw.sample(years, 2)
        x, y = draw.uniform(east_from + window_px / 2, width - window_px / 2 - 1), draw.uniform(window_px / 2, height - window_px / 2 - 1)
        dx, dy = (draw.uniform(-30, 30) for _ in range(2))
        cut = lambda picture, size, at: cv2.getRectSubPix(picture, (size, size), at)
        yield [cut(first, side, (x + dx, y + dy))], cut(second, window_px, (x, y)), (window_px / 2 + dx, window_px / 2 + dy), 5.0, 15


def looks_of_pairs(folder, draw, each=12, side=96, window_px=256):
    for row in rows(folder / "pairs.csv"):
        if int(row["inliers"]) < 50:
            continue  # the transform is in doubt
        source = cv2.imread(str(folder / f"{row['pair']}_src.jpg"), cv2.IMREAD_GRAYSCALE)
        target = cv2.imread(str(folder / f"{row['pair'].split('_')[0]}_tgt.jpg"), cv2.IMREAD_GRAYSCALE)
        matrix = numpy.array([[float(row[f"a{i}{j}"]) for j in (1, 2, 3)] for i in (1, 2)])
        flags, size = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, source.shape[::-1]
        shown = cv2.warpAffine(numpy.full_like(target, 255), matrix, size, flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP)
        half = lambda picture: cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        source, target, shown = map(half, (source, cv2.warpAffine(target, matrix, size, flags=flags), shown))
        if min(source.shape) <= window_px:
            continue
        cut = lambda picture, size, at: cv2.getRectSubPix(picture, (size, size), at)
        found = 0
        for _ in range(400):
            x, y = (draw.uniform(window_px / 2, size - window_px / 2) for size in source.shape[::-1])
            dx, dy = (draw.uniform(-70, 70) for _ in range(2))
            if found < each and cut(shown, window_px, (x, y)).min() == 255:
                found += 1
                yield [cut(source, side, (x + dx, y + dy))], cut(target, window_px, (x, y)), (window_px / 2 + dx, window_px / 2 + dy), 1.0, 10


def correlation(template, window, cache):
    """Normalised, over all channels, means removed. template (C, h, w), window (C, H, W)."""
    (_, height, width), (rows_, columns) = template.shape, window.shape[1:]
    if "spectrum" not in cache:
        cache["shape"] = fft.next_fast_len(rows_, True), fft.next_fast_len(columns, True)
        cache["spectrum"] = fft.rfft2(window, cache["shape"])
    if (height, width) not in cache:

        def box(x):
            sums = numpy.zeros((x.shape[0], rows_ + 1, columns + 1))
            sums[:, 1:, 1:] = x.cumsum(1, dtype=numpy.float64).cumsum(2)
            return sums[:, height:, width:] - sums[:, :-height, width:] - sums[:, height:, :-width] + sums[:, :-height, :-width]

        energy = (box(window**2) - box(window) ** 2 / (height * width)).sum(0)
        cache[height, width] = numpy.sqrt(numpy.maximum(energy, 1e-6))
    template = template - template.mean((1, 2), keepdims=True)
    product = (fft.rfft2(template, cache["shape"]).conj() * cache["spectrum"]).sum(0)
    scores = fft.irfft2(product, cache["shape"])[: rows_ - height + 1, : columns - width + 1]
    return scores / (numpy.sqrt((template**2).sum()) * cache[height, width])


def judged(network, look):
    """Error in metres, whether that is right, and the best score elsewhere over the best one."""
    templates, window, truth, gsd_m, tolerance_m = look
    stride, margin = network.stride, max(1, network.margin_px // network.stride)
    describe = lambda grey: network(torch.from_numpy(grey)[None, None].float() / 255)[0].numpy()
    with torch.no_grad():
        described, cache = describe(window), {}
        cells = [describe(template)[:, margin:-margin, margin:-margin] for template in templates]
    scores = numpy.maximum.reduce([correlation(template, described, cache) for template in cells])
    y, x = divmod(int(scores.argmax()), scores.shape[1])
    middle = templates[0].shape[0] / 2 - margin * stride
    error_m = math.hypot(x * stride + middle - truth[0], y * stride + middle - truth[1]) * gsd_m
    ys, xs = numpy.mgrid[: scores.shape[0], : scores.shape[1]]
    rival = scores[numpy.hypot(xs - x, ys - y) * stride > 12].max()
    return error_m, error_m <= tolerance_m, rival / scores[y, x]


def judge(options):
    torch.set_num_threads(1)
    data = options.data
    sets = {
        "fengyuan": lambda draw: looks_of_flight(data / "fengyuan", data / "fengyuan/map.tif", draw),
        "arroio, January": lambda draw: looks_of_flight(data / "arroio", data / "arroio/map_2014-01.tif", draw),
        "arroio, March": lambda draw: looks_of_flight(data / "arroio", data / "arroio/map_2014-03.tif", draw),
        "NAIP, other years": lambda draw: looks_of_years(data / "naip", draw),
        "gearth_pairs": lambda draw: looks_of_pairs(data / "gearth_pairs", draw),
    }
    if not data.is_dir():
        print(f"NOT RUN: {data} is missing")
        return
    networks = {str(path): load(path) for path in ["oriented-gradients", *options.files]}
    print(f"{'':20s} {'looks':>5s}" + "".join(f"  {pathlib.Path(name).stem:>24s}" for name in networks) + "  both right")
    print(f"{'':26s}" + f"  {'right  clean      ms':>24s}" * len(networks))
    for name, make in sets.items():
        results, milliseconds = {key: [] for key in networks}, dict.fromkeys(networks, 0.0)
        for index, look in enumerate(make(random.Random(5))):
            if index % options.share:
                continue
            for key, network in networks.items():
                begun = time.process_time()
                results[key].append(judged(network, look))
                milliseconds[key] += 1000 * (time.process_time() - begun)
        count, line = len(next(iter(results.values()))), ""
        for key, outcomes in results.items():
            wrong = min((ratio for _, right, ratio in outcomes if not right), default=2)
            clean = sum(right and ratio < wrong for _, right, ratio in outcomes)
            line += f"  {sum(o[1] for o in outcomes):8d} {clean:6d} {milliseconds[key] / count:7.0f}"
        both = sum(all(outcome[1] for outcome in outcomes) for outcomes in zip(*results.values()))
        print(f"{name:20s} {count:5d}{line}  {both:10d}", flush=True)


def main():
    parser = argparse.ArgumentParser(prog="./run bench own-network", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    training = commands.add_parser("train")
    training.add_argument("folder", type=pathlib.Path)
    training.add_argument("--out", type=pathlib.Path, required=True)
    training.add_argument("--network", choices=Network.LAYERS, default="small")
    training.add_argument("--seconds", type=float, default=600)
    training.add_argument("--batch", type=int, default=64)
    training.add_argument("--seed", type=int, default=1)
    judging = commands.add_parser("judge")
    judging.add_argument("files", type=pathlib.Path, nargs="*")
    judging.add_argument("--data", type=pathlib.Path, default=pathlib.Path("../shared/data"))
    judging.add_argument("--share", type=int, default=1, help="every N-th look")
    options = parser.parse_args()
    train(options) if options.command == "train" else judge(options)


if __name__ == "__main__":
    main()
