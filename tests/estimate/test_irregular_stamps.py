"""Noise of readings whose logger stamps them now closer, now further apart than its period."""

from dataclasses import replace

import numpy as np
from scipy.linalg import cholesky, toeplitz

from shockrig.analysis.estimate.channel import as_single_samples
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.noise import MAX_AVERAGED, Noise, whiteners
from shockrig.files.campaign import read_campaign


def test_a_run_that_was_logged_faster_than_the_others_has_noise_too():
    """Half a period between its readings: they count as one period apart, over a run twice as long."""
    channel = build_channel(read_campaign("data/examples/plain-rough"), "temperature").select(np.array([0]))
    time, value = channel.samples[0]
    time = time[0] + 0.5 * channel.sampling_period_s * np.arange(time.size)
    noise = Noise(0.001, 0.02, 0.99, 1, 0.0, 50, np.zeros(MAX_AVERAGED))
    single = as_single_samples(replace(channel, samples=((time, value),), bin_of=(np.arange(time.size),)))
    whitener = whiteners(replace(single, count=np.ones_like(single.count)), noise)[0]
    draws = np.random.default_rng(3).normal(size=(time.size, 100))
    readings = cholesky(toeplitz(noise.autocovariance(time.size)), lower=True) @ draws
    assert 0.9 < np.sqrt(np.mean((whitener @ readings) ** 2)) < 1.1


def test_two_readings_within_half_a_period_are_two_readings():
    """Their noise has much in common, not all: taken for the same, their difference would weigh without a limit."""
    channel = build_channel(read_campaign("data/examples/plain-rough"), "temperature").select(np.array([0]))
    period, (time, value) = channel.sampling_period_s, channel.samples[0]
    time = time[0] + period * (np.arange(time.size) + 0.7 * (np.arange(time.size) % 5 == 0))
    noise = Noise(0.01, 0.02, 0.9, 2, 0.003, 50, np.zeros(MAX_AVERAGED))
    bins = (np.arange(time.size),)
    single = as_single_samples(replace(channel, samples=((time, value),), bin_of=bins))
    whitener = whiteners(replace(single, count=np.ones_like(single.count)), noise)[0]
    draws = np.random.default_rng(3).normal(size=(time.size, 100))
    readings = cholesky(toeplitz(noise.autocovariance(time.size)), lower=True) @ draws
    assert 0.9 < np.sqrt(np.mean((whitener @ readings) ** 2)) < 1.1
