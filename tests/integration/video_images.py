"""Reads videos for the tests."""
import cv2


def images_of(video, max_images=None):
    """All its images, BGR, or the first `max_images`."""
    capture, images = cv2.VideoCapture(str(video)), []
    while len(images) != max_images and (read := capture.read())[0]:
        images.append(read[1])
    return images
