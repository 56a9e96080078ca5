! Ray casting: a tile of a CSG scene, one ray a PE: intersections, combination, shading (thesis 4, appendices A and B)
ENTRY SUBROUTINE RAYCAST(KIND, INVERSE, LEAVES, OPERATORS, OBJECTS, N, COLOURS, MATERIAL, LIGHT, LIGHTCOLOUR, LIGHTS, &
    AMBIENT, BACKGROUND, CAMERA, CENTRE, FOCAL, CLOSE, ROWS, COLUMNS, IMAGE, DEPTH, NORMAL, OBJECT, FACE)
  IMPLICIT NONE
! KIND: of each leaf, 0 block, 1 cylinder, 2 cone, 3 sphere, in the unit frames of Table 4.1, to which INVERSE leads
! OPERATORS(i), OBJECTS(i): the tree; '0' and a leaf's number, or U, I, D
! COLOURS: of each leaf's faces; MATERIAL: ambient, diffuse, specular, shininess; LIGHT: places; AMBIENT: of the light
! CAMERA: 3 x 4, scene from camera; CENTRE: pixel of the axis in the tile, from 0; FOCAL: in pixels; CLOSE: one place
! IMAGE: linear; DEPTH: along the axis, -1 where nothing is met; OBJECT: the leaf whose face is seen, 0 for none
  INTEGER LEAVES, N, LIGHTS, ROWS, COLUMNS, KIND(LEAVES), OBJECTS(N), OBJECT(*ROWS,*COLUMNS), FACE(*ROWS,*COLUMNS)
  CHARACTER OPERATORS(N)
  REAL*8 INVERSE(3, 4, LEAVES), COLOURS(3, 6, LEAVES), MATERIAL(4, LEAVES), LIGHT(3, LIGHTS), LIGHTCOLOUR(3, LIGHTS)
  REAL*8 AMBIENT(3), BACKGROUND(3), CAMERA(3, 4), CENTRE(2), FOCAL(2), CLOSE
  REAL*8 IMAGE(*ROWS,*COLUMNS,3), DEPTH(*ROWS,*COLUMNS), NORMAL(*ROWS,*COLUMNS,3)
  REAL*8 X(*ROWS,*COLUMNS), Y(*ROWS,*COLUMNS), RAY(*ROWS,*COLUMNS,3), L(*ROWS,*COLUMNS,3), P(3)
  REAL*8 T(*ROWS,*COLUMNS, 2*LEAVES + 2, LEAVES + 1)
  INTEGER WHOSE(*ROWS,*COLUMNS, 2*LEAVES + 2, LEAVES + 1), LENGTHS(LEAVES + 1), I, J, K, SP
  LOGICAL HIT(*ROWS,*COLUMNS)
  X = MATR((LENGTH(FLOAT(INDEX(COLUMNS) - 1), 8) - CENTRE(1))/FOCAL(1), ROWS)
  Y = MATC((LENGTH(FLOAT(INDEX(ROWS) - 1), 8) - CENTRE(2))/FOCAL(2), COLUMNS)
  DO 10 J = 1, 3
    RAY(,,J) = X*CAMERA(J,1) + Y*CAMERA(J,2) + CAMERA(J,3)
10 CONTINUE
  SP = 0
  DO 100 I = 1, N
    IF (OPERATORS(I) .NE. '0') GOTO 50
    K = OBJECTS(I)
    SP = SP + 1
!   the ray in the leaf's own frame; along a face it keeps a trace of a slope
    DO 20 J = 1, 3
      P(J) = INVERSE(J,1,K)*CAMERA(1,4) + INVERSE(J,2,K)*CAMERA(2,4) + INVERSE(J,3,K)*CAMERA(3,4) + INVERSE(J,4,K)
      L(,,J) = INVERSE(J,1,K)*RAY(,,1) + INVERSE(J,2,K)*RAY(,,2) + INVERSE(J,3,K)*RAY(,,3)
      L(ABS(L(,,J)) .LT. 1.0D-13*(ABS(INVERSE(J,1,K)) + ABS(INVERSE(J,2,K)) + ABS(INVERSE(J,3,K))), J) = 1.0D-300
20  CONTINUE
    CALL LEAF(KIND(K), K, P, L, CLOSE, T(,,1,SP), T(,,2,SP), WHOSE(,,1,SP), WHOSE(,,2,SP))
    LENGTHS(SP) = 2
    GOTO 100
50  CONTINUE
    CALL COMBINE(T, WHOSE, LENGTHS, 2*LEAVES + 2, LEAVES + 1, SP - 1, SP, CLOSE, OPERATORS(I))
    SP = SP - 1
100 CONTINUE
! the first boundary before the camera
  DEPTH = -1.0D0
  OBJECT = 0
  FACE = 0
  DO 110 I = LENGTHS(1), 1, -1
    HIT = T(,,I,1) .GT. 0.0D0 .AND. T(,,I,1) .LT. 5.0D29
    DEPTH(HIT) = T(,,I,1)
    OBJECT(HIT) = WHOSE(,,I,1)/6
    FACE(HIT) = MOD(WHOSE(,,I,1), 6)
110 CONTINUE
  CALL SHADE(KIND, INVERSE, LEAVES, COLOURS, MATERIAL, LIGHT, LIGHTCOLOUR, LIGHTS, AMBIENT, BACKGROUND, CAMERA, &
    RAY, DEPTH, OBJECT, FACE, NORMAL, IMAGE)
END

! Where rays enter and leave a primitive of a unit frame, 1E30 twice where they miss it, and 6 times the leaf and a face
SUBROUTINE LEAF(KIND, K, P, L, CLOSE, ENTER, LEAVE, FACEIN, FACEOUT)
  IMPLICIT NONE
  INTEGER KIND, K, FACEIN(,), FACEOUT(,)
  REAL*8 P(3), L(,,3), CLOSE, ENTER(,), LEAVE(,)
  LOGICAL MISS(*SIZE(ENTER, 1), *SIZE(ENTER, 2))
  ENTER = -1.0D30
  LEAVE = 1.0D30
  FACEIN = 0
  FACEOUT = 0
  GOTO (1, 2, 3, 4), KIND + 1
1 CONTINUE
  CALL SLAB(P(1), L(,,1), 0, 1, ENTER, LEAVE, FACEIN, FACEOUT)
  CALL SLAB(P(2), L(,,2), 2, 3, ENTER, LEAVE, FACEIN, FACEOUT)
  CALL SLAB(P(3), L(,,3), 4, 5, ENTER, LEAVE, FACEIN, FACEOUT)
  GOTO 9
2 CONTINUE
  CALL SLAB(P(3), L(,,3), 0, 1, ENTER, LEAVE, FACEIN, FACEOUT)
  CALL ROUND(P, L, 0.0D0, 1.0D0, 2, ENTER, LEAVE, FACEIN, FACEOUT)
  GOTO 9
3 CONTINUE
  CALL CONE(P, L, ENTER, LEAVE, FACEIN, FACEOUT)
  GOTO 9
4 CONTINUE
  CALL ROUND(P, L, 1.0D0, 1.0D0, 0, ENTER, LEAVE, FACEIN, FACEOUT)
9 CONTINUE
  MISS = .NOT. (LEAVE - ENTER .GT. CLOSE)
  ENTER(MISS) = 1.0D30
  LEAVE(MISS) = 1.0D30
  FACEIN = FACEIN + 6*K
  FACEOUT = FACEOUT + 6*K
END

! Keep of a span what lies between two planes of one coordinate, at 0 and at 1
SUBROUTINE SLAB(P, D, FACE0, FACE1, ENTER, LEAVE, FACEIN, FACEOUT)
  IMPLICIT NONE
  REAL*8 P, D(,), ENTER(,), LEAVE(,)
  INTEGER FACE0, FACE1, FACEIN(,), FACEOUT(,)
  REAL*8 T0(*SIZE(D, 1), *SIZE(D, 2)), T1(*SIZE(D, 1), *SIZE(D, 2)), S(*SIZE(D, 1), *SIZE(D, 2))
  LOGICAL RISING(*SIZE(D, 1), *SIZE(D, 2)), M(*SIZE(D, 1), *SIZE(D, 2))
  T0 = (0.0D0 - P)/D
  T1 = (1.0D0 - P)/D
  RISING = D .GT. 0.0D0
  S = MERGE(T0, T1, RISING)
  M = S .GT. ENTER
  ENTER(M) = S
  FACEIN(M) = MERGE(FACE0, FACE1, RISING)
  S = MERGE(T1, T0, RISING)
  M = S .LT. LEAVE
  LEAVE(M) = S
  FACEOUT(M) = MERGE(FACE1, FACE0, RISING)
END

! Roots of A t**2 + 2 B t + C without cancellation, the lower first; TRUE: where they are real and distinct
SUBROUTINE ROOTS(A, B, C, LOW, HIGH, TRUE)
  IMPLICIT NONE
  REAL*8 A(,), B(,), C, LOW(,), HIGH(,)
  LOGICAL TRUE(,)
  REAL*8 D(*SIZE(A, 1), *SIZE(A, 2)), Q(*SIZE(A, 1), *SIZE(A, 2)), S(*SIZE(A, 1), *SIZE(A, 2))
  D = B*B - A*C
  TRUE = D .GT. 0.0D0
  D = SQRT(MERGE(D, 1.0D0, TRUE))
  Q = -(B + SIGN(D, B))
  Q(Q .EQ. 0.0D0) = 1.0D-300
  S = MERGE(1.0D-300, A, ABS(A) .LT. 1.0D-300)
  LOW = MIN(Q/S, C/Q)
  HIGH = MAX(Q/S, C/Q)
END

! Keep of a span what lies in x**2 + y**2 + ZZ z**2 <= LIMIT, a cylinder or a sphere
SUBROUTINE ROUND(P, L, ZZ, LIMIT, FACE, ENTER, LEAVE, FACEIN, FACEOUT)
  IMPLICIT NONE
  REAL*8 P(3), L(,,3), ZZ, LIMIT, ENTER(,), LEAVE(,), C
  INTEGER FACE, FACEIN(,), FACEOUT(,)
  REAL*8 A(*SIZE(ENTER, 1), *SIZE(ENTER, 2)), B(*SIZE(ENTER, 1), *SIZE(ENTER, 2))
  REAL*8 LOW(*SIZE(ENTER, 1), *SIZE(ENTER, 2)), HIGH(*SIZE(ENTER, 1), *SIZE(ENTER, 2))
  LOGICAL TRUE(*SIZE(ENTER, 1), *SIZE(ENTER, 2)), ALONG(*SIZE(ENTER, 1), *SIZE(ENTER, 2))
  LOGICAL M(*SIZE(ENTER, 1), *SIZE(ENTER, 2))
  A = L(,,1)*L(,,1) + L(,,2)*L(,,2) + ZZ*L(,,3)*L(,,3)
  B = P(1)*L(,,1) + P(2)*L(,,2) + ZZ*P(3)*L(,,3)
  C = P(1)*P(1) + P(2)*P(2) + ZZ*P(3)*P(3) - LIMIT
! a ray along the axis is inside always or never
  ALONG = A .LT. 1.0D-300
  A(ALONG) = 1.0D0
  CALL ROOTS(A, B, C, LOW, HIGH, TRUE)
  LOW(.NOT. TRUE) = 1.0D30
  HIGH(.NOT. TRUE) = -1.0D30
  IF (C .LT. 0.0D0) LOW(ALONG) = -1.0D30
  IF (C .LT. 0.0D0) HIGH(ALONG) = 1.0D30
  M = LOW .GT. ENTER
  ENTER(M) = LOW
  FACEIN(M) = FACE
  M = HIGH .LT. LEAVE
  LEAVE(M) = HIGH
  FACEOUT(M) = FACE
END

! x**2 + y**2 <= z**2 and 0 <= z <= 1: of the double cone the upper half, in which a ray has one span; 0 is its base
SUBROUTINE CONE(P, L, ENTER, LEAVE, FACEIN, FACEOUT)
  IMPLICIT NONE
  REAL*8 P(3), L(,,3), ENTER(,), LEAVE(,), C
  INTEGER FACEIN(,), FACEOUT(,)
  REAL*8 A(*SIZE(ENTER, 1), *SIZE(ENTER, 2)), B(*SIZE(ENTER, 1), *SIZE(ENTER, 2))
  REAL*8 LOW(*SIZE(ENTER, 1), *SIZE(ENTER, 2)), HIGH(*SIZE(ENTER, 1), *SIZE(ENTER, 2))
  LOGICAL TRUE(*SIZE(ENTER, 1), *SIZE(ENTER, 2)), STEEP(*SIZE(ENTER, 1), *SIZE(ENTER, 2))
  LOGICAL RISING(*SIZE(ENTER, 1), *SIZE(ENTER, 2))
  A = L(,,1)*L(,,1) + L(,,2)*L(,,2) - L(,,3)*L(,,3)
  B = P(1)*L(,,1) + P(2)*L(,,2) - P(3)*L(,,3)
  C = P(1)*P(1) + P(2)*P(2) - P(3)*P(3)
  CALL ROOTS(A, B, C, LOW, HIGH, TRUE)
! a steep ray is inside before one root and after the other; going up only the second part is in the upper half
  STEEP = A .LT. 0.0D0
  RISING = L(,,3) .GT. 0.0D0
  ENTER = MERGE(MERGE(HIGH, -1.0D30, RISING), LOW, STEEP)
  LEAVE = MERGE(MERGE(1.0D30, LOW, RISING), HIGH, STEEP)
  LOW = (0.0D0 - P(3))/L(,,3)
  ENTER(STEEP .AND. .NOT. TRUE .AND. RISING) = LOW
  LEAVE(STEEP .AND. .NOT. TRUE .AND. .NOT. RISING) = LOW
  FACEIN = 1
  FACEOUT = 1
  CALL SLAB(P(3), L(,,3), 1, 0, ENTER, LEAVE, FACEIN, FACEOUT)
  ENTER(.NOT. (TRUE .OR. STEEP)) = 1.0D30
END

! Combine the lists at LEFT and RIGHT of the stack into LEFT; places that are CLOSE are one, that of the lowest face
SUBROUTINE COMBINE(T, WHOSE, LENGTHS, MOST, DEEP, LEFT, RIGHT, CLOSE, OPERATOR)
  IMPLICIT NONE
  INTEGER MOST, DEEP, LEFT, RIGHT, LENGTHS(DEEP), WHOSE(,,MOST,DEEP)
  REAL*8 T(,,MOST,DEEP), CLOSE
  CHARACTER OPERATOR
  REAL*8 A(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2), MOST), SWAP(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2))
  REAL*8 START(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2)), BESTT(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2))
  INTEGER W(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2), MOST), WS(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2))
  INTEGER COUNT(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2)), BEST(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2))
  LOGICAL FROM(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2), MOST), FS(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2))
  LOGICAL INL(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2)), INR(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2))
  LOGICAL INSIDE(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2)), NOW(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2))
  LOGICAL THERE(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2)), M(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2))
  INTEGER I, J, K, TOTAL
! merge: the left list, then each boundary of the right one moved down to its place
  TOTAL = LENGTHS(LEFT) + LENGTHS(RIGHT)
  DO I = 1, LENGTHS(LEFT)
    A(,,I) = T(,,I,LEFT)
    W(,,I) = WHOSE(,,I,LEFT)
    FROM(,,I) = .TRUE.
  END DO
  DO I = 1, LENGTHS(RIGHT)
    K = LENGTHS(LEFT) + I
    A(,,K) = T(,,I,RIGHT)
    W(,,K) = WHOSE(,,I,RIGHT)
    FROM(,,K) = .FALSE.
    DO J = K, 2, -1
      M = A(,,J-1) .GT. A(,,J)
      IF (.NOT. ANY(M)) GOTO 20
      SWAP = A(,,J)
      A(M, J) = A(,,J-1)
      A(M, J-1) = SWAP
      WS = W(,,J)
      W(M, J) = W(,,J-1)
      W(M, J-1) = WS
      FS = FROM(,,J)
      FROM(M, J) = FROM(,,J-1)
      FROM(M, J-1) = FS
    END DO
20  CONTINUE
  END DO
! scan: a boundary stays where the combination changes between in and out
  INL = .FALSE.
  INR = .FALSE.
  INSIDE = .FALSE.
  COUNT = 0
  START = -1.0D30
  BESTT = 0.0D0
  BEST = 0
  DO I = 1, TOTAL
    T(,,I,LEFT) = 1.0D30
    WHOSE(,,I,LEFT) = 0
  END DO
  DO 50 I = 1, TOTAL
    THERE = A(,,I) .LT. 5.0D29
    M = THERE .AND. A(,,I) - START .GT. CLOSE
    START(M) = A(,,I)
    M = M .OR. (THERE .AND. W(,,I) .LT. BEST)
    BESTT(M) = A(,,I)
    BEST(M) = W(,,I)
    INL(THERE .AND. FROM(,,I)) = .NOT. INL
    INR(THERE .AND. .NOT. FROM(,,I)) = .NOT. INR
    IF (OPERATOR .EQ. 'U') NOW = INL .OR. INR
    IF (OPERATOR .EQ. 'I') NOW = INL .AND. INR
    IF (OPERATOR .EQ. 'D') NOW = INL .AND. .NOT. INR
!   what follows closely is the same place, and is seen with it
    IF (I .LT. TOTAL) THERE = THERE .AND. A(,,I+1) - START .GT. CLOSE
    M = THERE .AND. (NOW .NEQV. INSIDE)
    INSIDE = INSIDE .NEQV. M
    COUNT(M) = COUNT + 1
    DO J = 1, I
      FS = M .AND. COUNT .EQ. J
      T(FS, J, LEFT) = BESTT
      WHOSE(FS, J, LEFT) = BEST
    END DO
50 CONTINUE
  LENGTHS(LEFT) = MAXV(COUNT)
  IF (LENGTHS(LEFT) .LT. 2) LENGTHS(LEFT) = 2
END

! Normals towards the eye, and light that is ambient, diffuse and specular, of lights without shadows
SUBROUTINE SHADE(KIND, INVERSE, LEAVES, COLOURS, MATERIAL, LIGHT, LIGHTCOLOUR, LIGHTS, AMBIENT, BACKGROUND, CAMERA, &
    RAY, DEPTH, OBJECT, FACE, NORMAL, IMAGE)
  IMPLICIT NONE
  INTEGER LEAVES, LIGHTS, KIND(LEAVES), OBJECT(,), FACE(,), I, J, K, F, FACES(4)
  REAL*8 INVERSE(3, 4, LEAVES), COLOURS(3, 6, LEAVES), MATERIAL(4, LEAVES), LIGHT(3, LIGHTS), LIGHTCOLOUR(3, LIGHTS)
  REAL*8 AMBIENT(3), BACKGROUND(3), CAMERA(3, 4), RAY(,,3), DEPTH(,), NORMAL(,,3), IMAGE(,,3)
  REAL*8 POINT(*SIZE(DEPTH, 1), *SIZE(DEPTH, 2), 3), G(*SIZE(DEPTH, 1), *SIZE(DEPTH, 2), 3)
  REAL*8 VIEW(*SIZE(DEPTH, 1), *SIZE(DEPTH, 2), 3), MIRROR(*SIZE(DEPTH, 1), *SIZE(DEPTH, 2), 3)
  REAL*8 TOLIGHT(*SIZE(DEPTH, 1), *SIZE(DEPTH, 2), 3), PAINT(*SIZE(DEPTH, 1), *SIZE(DEPTH, 2), 3)
  REAL*8 STUFF(*SIZE(DEPTH, 1), *SIZE(DEPTH, 2), 4), S(*SIZE(DEPTH, 1), *SIZE(DEPTH, 2))
  REAL*8 FACING(*SIZE(DEPTH, 1), *SIZE(DEPTH, 2)), SHINE(*SIZE(DEPTH, 1), *SIZE(DEPTH, 2)), SCALE
  LOGICAL HERE(*SIZE(DEPTH, 1), *SIZE(DEPTH, 2)), SEEN(*SIZE(DEPTH, 1), *SIZE(DEPTH, 2))
  DATA FACES /6, 3, 2, 1/
  SEEN = OBJECT .GT. 0
  NORMAL = 0.0D0
  PAINT = 0.0D0
  STUFF = 0.0D0
  S = MERGE(DEPTH, 1.0D0, SEEN)
  DO 10 J = 1, 3
    POINT(,,J) = CAMERA(J,4) + S*RAY(,,J)
    IMAGE(,,J) = BACKGROUND(J)
10 CONTINUE
  DO 50 K = 1, LEAVES
    HERE = OBJECT .EQ. K
    IF (.NOT. ANY(HERE)) GOTO 50
    DO 20 J = 1, 4
      STUFF(HERE, J) = MATERIAL(J,K)
20  CONTINUE
    DO 40 F = 0, FACES(KIND(K) + 1) - 1
      HERE = OBJECT .EQ. K .AND. FACE .EQ. F
      IF (.NOT. ANY(HERE)) GOTO 40
      CALL GRADIENT(KIND(K), F, INVERSE, LEAVES, K, POINT, G)
      S = SQRT(G(,,1)*G(,,1) + G(,,2)*G(,,2) + G(,,3)*G(,,3))
      S(S .EQ. 0.0D0) = 1.0D0
      DO 30 J = 1, 3
        NORMAL(HERE, J) = G(,,J)/S
        PAINT(HERE, J) = COLOURS(J, F + 1, K)
30    CONTINUE
40  CONTINUE
50 CONTINUE
! towards the eye
  S = NORMAL(,,1)*RAY(,,1) + NORMAL(,,2)*RAY(,,2) + NORMAL(,,3)*RAY(,,3)
  HERE = S .GT. 0.0D0
  SHINE = SQRT(RAY(,,1)*RAY(,,1) + RAY(,,2)*RAY(,,2) + RAY(,,3)*RAY(,,3))
  DO 60 J = 1, 3
    NORMAL(HERE, J) = -NORMAL(,,J)
    VIEW(,,J) = RAY(,,J)/SHINE
60 CONTINUE
  S = 2.0D0*(NORMAL(,,1)*VIEW(,,1) + NORMAL(,,2)*VIEW(,,2) + NORMAL(,,3)*VIEW(,,3))
  DO 70 J = 1, 3
    MIRROR(,,J) = VIEW(,,J) - S*NORMAL(,,J)
    IMAGE(SEEN, J) = STUFF(,,1)*PAINT(,,J)*AMBIENT(J)
70 CONTINUE
  DO 100 I = 1, LIGHTS
    DO 80 J = 1, 3
      TOLIGHT(,,J) = LIGHT(J,I) - POINT(,,J)
80  CONTINUE
    S = SQRT(TOLIGHT(,,1)*TOLIGHT(,,1) + TOLIGHT(,,2)*TOLIGHT(,,2) + TOLIGHT(,,3)*TOLIGHT(,,3))
    S(S .EQ. 0.0D0) = 1.0D0
    FACING = (NORMAL(,,1)*TOLIGHT(,,1) + NORMAL(,,2)*TOLIGHT(,,2) + NORMAL(,,3)*TOLIGHT(,,3))/S
    SHINE = (MIRROR(,,1)*TOLIGHT(,,1) + MIRROR(,,2)*TOLIGHT(,,2) + MIRROR(,,3)*TOLIGHT(,,3))/S
    HERE = SEEN .AND. FACING .GT. 0.0D0
    SHINE = MERGE(MERGE(SHINE, 1.0D0, SHINE .GT. 0.0D0)**STUFF(,,4), 0.0D0, SHINE .GT. 0.0D0)
    DO 90 J = 1, 3
      IMAGE(HERE, J) = IMAGE(,,J) + LIGHTCOLOUR(J,I)*(STUFF(,,2)*FACING*PAINT(,,J) + STUFF(,,3)*SHINE)
90  CONTINUE
100 CONTINUE
END

! The gradient of a face's surface in the scene, not of unit length
SUBROUTINE GRADIENT(KIND, F, INVERSE, LEAVES, K, POINT, G)
  IMPLICIT NONE
  INTEGER KIND, F, LEAVES, K, J, ROW
  REAL*8 INVERSE(3, 4, LEAVES), POINT(,,3), G(,,3)
  REAL*8 Q(*SIZE(POINT(,,1), 1), *SIZE(POINT(,,1), 2), 3)
  ROW = 3
  IF (KIND .EQ. 0) ROW = F/2 + 1
  IF ((KIND .EQ. 1 .AND. F .EQ. 2) .OR. (KIND .EQ. 2 .AND. F .EQ. 1) .OR. KIND .EQ. 3) GOTO 20
  DO 10 J = 1, 3
    G(,,J) = INVERSE(ROW,J,K)
10 CONTINUE
  RETURN
! of a curved face: from the place in the unit frame
20 CONTINUE
  DO 30 J = 1, 3
    Q(,,J) = INVERSE(J,1,K)*POINT(,,1) + INVERSE(J,2,K)*POINT(,,2) + INVERSE(J,3,K)*POINT(,,3) + INVERSE(J,4,K)
30 CONTINUE
  IF (KIND .EQ. 1) Q(,,3) = 0.0D0
  IF (KIND .EQ. 2) Q(,,3) = -Q(,,3)
  DO 40 J = 1, 3
    G(,,J) = INVERSE(1,J,K)*Q(,,1) + INVERSE(2,J,K)*Q(,,2) + INVERSE(3,J,K)*Q(,,3)
40 CONTINUE
END
